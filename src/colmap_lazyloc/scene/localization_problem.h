#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/intrinsics_parameter.h"
#include "colmap_lazyloc/scene/match.h"
#include "colmap_lazyloc/scene/query_prior.h"
#include "colmap_lazyloc/scene/two_view_geometry.h"

namespace lazyloc {

// Verified matches of a database image with another posed image.
struct NeighbourPair {
  Camera camera;  // of the other image, and its pose
  Rigid3d cam_from_world;
  std::vector<Eigen::Vector2d> points, other_points;  // matched keypoints of the two images, in pixels
};

// What a query shares with another image: a database image, or another query of its group.
struct ImagePair {
  std::string other_name;
  Camera other_camera;
  std::vector<Eigen::Vector2d> other_keypoints;  // all keypoints of the image, xy in pixels
  // Stored geometry that is valid for both cameras; without it the relative pose is estimated from `matches`.
  std::optional<TwoViewGeometry> geometry;
  Matches matches;  // raw matches; empty if `geometry` is enough
  // Depths along the optical axis at other_keypoints: as the image's depth map states them, and of points that it and
  // other database images triangulate. 0: unknown. Both are empty for an image without a map.
  std::vector<float> other_depths, other_point_depths;

  // Database images only: the known pose, which no stage changes, and the rig frame that the image belongs to (empty
  // for a single image). Images of one frame have the same name.
  Rigid3d database_cam_from_world;
  std::string database_frame_name;
  Rigid3d database_cam_from_rig;  // of the image's camera in that frame's rig
  // Pairs of the database image with others, which tell the size of the errors of database poses. Only loaded if the
  // query has few database images.
  std::vector<NeighbourPair> neighbours;
};

// Everything that localizing one query needs.
struct LocalizationProblem {
  std::string query_name;
  Camera query_camera;
  IntrinsicsOrigin intrinsics_origin = IntrinsicsOrigin::GIVEN;               // of query_camera
  IntrinsicsCovariance intrinsics_covariance = IntrinsicsCovariance::Zero();  // JOINT only
  std::vector<Eigen::Vector2d> query_keypoints;                               // xy in pixels
  std::vector<ImagePair> pairs;  // with database images, sorted by other_name
  int max_num_pairs = 0;         // that are used: those with the most verified inliers; 0: all
  QueryPrior prior;
};

// A query of a group and its place in its frame.
struct QueryImage {
  LocalizationProblem problem;
  int frame = 0;         // index into QueryGroup::frame_names
  Rigid3d cam_from_rig;  // identity if the rig is unknown
  double rig_scale = 1;  // that the translation of cam_from_rig has been multiplied with
};

// Two queries of a group that share matches.
struct QueryPair {
  int query = -1;    // index into QueryGroup::images
  int other = -1;    // smaller than `query`
  ImagePair images;  // without a pose
};

// Queries that are localized together. A frame is a set of images that move as one rigid body: a camera rig at one
// moment, a piece of a known trajectory, or a single image.
struct QueryGroup {
  std::vector<std::string> frame_names;  // empty string: a single image
  std::vector<QueryImage> images;        // in ascending order of their frames; each frame has at least one
  std::vector<QueryPair> query_pairs;
  // True if the translations in cam_from_rig are in database units; else their scale is estimated for each frame.
  bool has_rig_scale = true;
};

}  // namespace lazyloc

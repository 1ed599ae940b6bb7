#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/match.h"
#include "colmap_lazyloc/scene/two_view_geometry.h"

namespace lazyloc {

// A database image with what the query shares with it. Its pose is known and stays as it is.
struct ImagePair {
  std::string database_name;
  Camera database_camera;
  Rigid3d database_cam_from_world;
  std::vector<Eigen::Vector2d> database_keypoints;  // xy in pixels, all of the image
  // Stored and valid for the cameras above; else the relative pose is estimated from `matches`.
  std::optional<TwoViewGeometry> geometry;
  Matches matches;  // raw; left empty where `geometry` is enough
};

// Verified matches between the database images of two pairs.
struct DatabaseMatches {
  int pair1 = -1, pair2 = -1;                            // into the problem's pairs
  std::vector<std::pair<uint32_t, uint32_t>> keypoints;  // of pair1's image, of pair2's image
};

// Everything that localizing one query needs.
struct LocalizationProblem {
  std::string query_name;
  Camera query_camera;
  std::vector<Eigen::Vector2d> query_keypoints;   // xy in pixels
  std::vector<ImagePair> pairs;                   // sorted by database_name
  std::vector<DatabaseMatches> database_matches;  // where they are to extend the tracks
};

// A query that is localized together with others, and its place in its frame: the images that move as one rigid body
// (of a camera rig at one moment, of a piece of a known trajectory, or a lone image).
struct GroupMember {
  LocalizationProblem problem;
  int reference = 0;  // the frame's first member; members of a frame stand together
  Rigid3d cam_from_rig;
  std::string frame_name;  // empty for a lone image
};

// Two members of a group that share matches.
struct QueryPair {
  int query = -1;
  int other = -1;    // before `query`
  ImagePair images;  // `other` takes the database image's part, without its pose
};

// Queries that are localized together, in one or several frames.
struct QueryGroup {
  std::vector<GroupMember> members;
  std::vector<QueryPair> query_pairs;
  // Whether the lengths in cam_from_rig are in database units; else their unit is found for each frame.
  bool has_rig_scale = true;
};

}  // namespace lazyloc

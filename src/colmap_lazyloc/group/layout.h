#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/group/localizer_options.h"
#include "colmap_lazyloc/scene/database_pose_noise.h"
#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// The images and frames of a group with the poses as given. Images 0 to num_queries - 1 are the group's queries in
// their order, the others database images; frames 0 to num_query_frames - 1 are the group's. Immutable after
// MakeLayout.
struct Layout {
  PosedImages given;               // poses of query frames are unknown (identity)
  std::vector<std::string> names;  // by image
  int num_queries = 0;
  int num_query_frames = 0;
  bool has_depths = false;  // true if database images have depth maps
  Eigen::Vector3d origin =
      Eigen::Vector3d::Zero();                  // subtracted from all coordinates: solvers work near zero (UTM, ECEF)
  std::vector<QueryPrior> priors;               // by query, with positions relative to the origin
  std::vector<std::vector<int>> image_of_pair;  // [query][index into its pairs]
  std::vector<std::vector<int>> queries_of_frame;          // by query frame
  std::vector<std::vector<int>> database_frames_of_frame;  // by query frame; ascending
  std::vector<ExpectedPoseErrors> expected_pose_errors;    // by query frame; empty: as the options say

  bool IsDatabase(int image) const { return image >= num_queries; }
  int FrameOf(int image) const { return given.images[image].frame; }
  // Returns the queries of a query frame, in ascending order.
  const std::vector<int>& QueriesOf(int frame) const { return queries_of_frame[frame]; }
};

// Gives each query frame database images and frames of its own, even if frames share database images, because the
// correction of a database pose depends on the query: it is relative to the pose error at the query's viewpoint.
Layout MakeLayout(const QueryGroup& group);

// Returns the pose of a query in the database's coordinates.
Rigid3d PoseInWorld(const Layout& layout, const PosedImages& posed, int query);

// Returns for each query frame the tracks that it observes.
std::vector<TrackRefs> TracksByFrame(const Layout& layout, const std::vector<Track>& tracks);

}  // namespace lazyloc

#pragma once

#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "colmap_lazyloc/bridge/observer.h"
#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/scene/pair_geometry.h"
#include "colmap_lazyloc/scene/stage_timer.h"
#include "colmap_lazyloc/two_view/relative_pose.h"

namespace lazyloc {

// Relative poses and inliers that were found before for the same cameras, so that no pair is estimated twice. By
// whether the focal length is used, the name of the query, whether the other image is a query, and its name; nullopt
// for pairs without geometry.
using KnownRelativePoses = std::map<std::tuple<bool, std::string, bool, std::string>, std::optional<RelativePose>>;

struct PairEstimates {
  // Verified pairs of queries with database images (of each query the max_num_pairs with most inliers), then of queries
  // with each other.
  std::vector<PairGeometry> pairs;
  std::vector<std::vector<int>> num_inliers;  // [query][index into its pairs]; zero for pairs without geometry
};

// Finds the relative pose and the inliers of each pair (stored, or estimated by COLMAP), and unprojects the inliers'
// keypoints: the first box of LazyLoc's figure. Adds them to those that are known. Throws Failure for frames without
// any pair. uses_focal_length: false for a query of unknown focal length, whose relative poses nothing can tell, so
// that query_from_other is not set.
PairEstimates EstimatePairs(const QueryGroup& group, const Layout& layout, bool uses_focal_length,
                            const LocalizerOptions& options, KnownRelativePoses* known, StageTimer::Seconds* seconds);

}  // namespace lazyloc

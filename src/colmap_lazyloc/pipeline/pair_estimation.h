#pragma once

#include <vector>

#include "colmap_lazyloc/bridge/observation.h"
#include "colmap_lazyloc/pipeline/layout.h"
#include "colmap_lazyloc/scene/pair_geometry.h"
#include "colmap_lazyloc/scene/stage_timer.h"

namespace lazyloc {

struct PairEstimates {
  // Verified pairs of queries with database images (of each query the max_num_pairs with most inliers), then of queries
  // with each other.
  std::vector<PairGeometry> pairs;
  std::vector<std::vector<int>> num_inliers;  // [query][index into its pairs]; zero for pairs without geometry
};

// Finds the relative pose and the inliers of each pair (stored, or estimated by COLMAP), and unprojects the inliers'
// keypoints: the first box of LazyLoc's figure. Throws Failure for frames without any pair.
PairEstimates EstimatePairs(const QueryGroup& group, const Layout& layout, const LocalizerOptions& options,
                            StageTimer::Seconds* seconds);

// Does the same for a query of unknown focal length, whose relative poses nothing can tell: query_from_other is not
// set. The observations have their derivative with respect to the focal length.
PairEstimates FindInliers(const QueryGroup& query, const Layout& layout, const LocalizerOptions& options,
                          StageTimer::Seconds* seconds);

}  // namespace lazyloc

#pragma once

#include <vector>

#include "colmap_lazyloc/pipeline/intrinsics_check.h"

namespace lazyloc {

// Returns true if FusePriors uses the priors of a query. Adjustment uses them for images of a rig, because these share
// a pose, and beside an estimated focal length, because that changes with the pose.
bool IsFused(const Layout& layout, const PosedImages& posed, int query);

// Combines the priors of such queries with their poses: the most probable pose under the pose's whole covariance and
// the priors' own. Adjustment does not know this covariance, because it contains errors that all images share: of the
// database poses, and of the focal length. A prior that the images contradict is left out (prior_comparison.h). Leaves
// queries alone whose priors have a verdict. results: by query.
void FusePriors(const Layout& layout, std::vector<QueryPriorResult>* results, CheckedIntrinsics* checked);

}  // namespace lazyloc

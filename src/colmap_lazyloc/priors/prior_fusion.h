#pragma once

#include <vector>

#include "colmap_lazyloc/intrinsics/intrinsics_check.h"

namespace lazyloc {

// Returns true if FusePriors uses the priors of a query. Adjustment uses them for images of a rig, because these share
// a pose, and beside an estimated focal length, because that changes with the pose.
bool IsFused(const Layout& layout, const PosedImages& posed, int query);

// Poses with the priors that were combined with them, and what became of the priors, by query.
struct FusedPriors {
  CheckedIntrinsics checked;
  std::vector<QueryPriorResult> results;
};

// Combines the priors of such queries with their poses: the most probable pose under the priors' covariances and the
// pose's own. Adjustment does not know the latter, because it contains errors of the database poses that all images
// share. The error of a given focal length is allowed for in the covariance, but a prior is not weighed against it,
// because most given focal lengths are better than that. A prior that the images contradict is left out
// (prior_comparison.h). Leaves queries alone whose priors have a verdict. results: by query.
FusedPriors FusePriors(const Layout& layout, std::vector<QueryPriorResult> results, CheckedIntrinsics checked);

}  // namespace lazyloc

#pragma once

#include <optional>
#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/scene/pair_geometry.h"
#include "colmap_lazyloc/uncertainty/refined.h"

namespace lazyloc {

// The comparison of the queries' priors with the poses that the images give.
struct PriorJudgement {
  std::vector<QueryPriorResult> results;  // by query
  std::vector<ImagePrior> used;           // for PosedImages::query_priors of the adjustment
  // The most probable pose under images and priors, to start from, if the priors fix an unobservable position.
  std::optional<Rigid3d> start;
  std::optional<UnobservableLine> unobservable_line;  // then
};

// Compares the priors with poses that were refined without them (prior_comparison.h). A prior that these contradict is
// not used. If the position of a single query is unobservable, only what the images determine is compared. Leaves
// priors untested that FusePriors uses (prior_fusion.h).
PriorJudgement JudgePriors(const Layout& layout, const PairRefs& pairs, const Refined& refined,
                           const LocalizerOptions& options);

// Adjusts refined poses that the images determine once more, with the priors. Returns them as they are without any
// prior, or if that fails.
Refined AdjustWithPriors(const std::vector<ImagePrior>& priors, const LocalizerOptions& options, Refined refined);

// Raises a variance factor so small that a prior beside the images would have no weight.
Refined WithLimitedVarianceFactor(Refined refined);

// Returns false if an adjustment with priors that fix a position has not reconciled them with the images: the adjusted
// position then deviates from its prior as if contradicted, or all points have moved into the query's projection
// centre.
bool AreReconciled(const Refined& refined);

}  // namespace lazyloc

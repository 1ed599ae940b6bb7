#pragma once

#include <vector>

#include "colmap_lazyloc/pipeline/refinement_rounds.h"
#include "colmap_lazyloc/priors/query_priors.h"
#include "colmap_lazyloc/scene/stage_timer.h"

namespace lazyloc {

bool HavePriors(const Layout& layout);

struct RefinedWithPriors {
  Refined refined;
  std::vector<QueryPriorResult> priors;  // by query
};

// Refines by the images alone, compares the queries' priors with the result and refines with those that it does not
// contradict. Poses whose position is unobservable start again from where the priors put them. Beside a single database
// image, chooses between the two orientations that a plane leaves (plane_orientation.h).
RefinedWithPriors RefineWithPriors(const Layout& layout, const PairRefs& pairs, const PosedImages& start,
                                   const SplitTracks& start_tracks, CandidateTracks candidates,
                                   const LocalizerOptions& options, StageTimer::Seconds* seconds);

}  // namespace lazyloc

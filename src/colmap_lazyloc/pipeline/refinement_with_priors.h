#pragma once

#include <vector>

#include "colmap_lazyloc/pipeline/query_priors.h"
#include "colmap_lazyloc/pipeline/report.h"

namespace lazyloc {

bool HavePriors(const Layout& layout);

struct RefinedWithPriors {
  Refined refined;
  std::vector<QueryPriorResult> priors;  // by query, as far as they were compared
};

// Refines by the images alone, compares the queries' priors with the result and refines with those that it does not
// contradict. Moves the start of poses that the images leave open to where the priors put them. Beside a single
// database image, chooses between the two orientations that a plane leaves (plane_orientation.h).
RefinedWithPriors RefineWithPriors(const Layout& layout, const PairRefs& pairs, const SplitTracks& start_tracks,
                                   CandidateTracks candidates, const LocalizerOptions& options, Report* report,
                                   Start* start);

}  // namespace lazyloc

#pragma once

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// What the paper compares its post optimization with: leaves the query's pose refined without points. Its covariance is
// not known (NaN). The query is alone in its group.
void RefineWithoutTracks(QueryState* state);

}  // namespace lazyloc

#pragma once

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// Fills the result's covariance from the last adjustment. Throws QueryFailure where the image noise leaves the position
// open, and says what kind of view leaves it so.
void EstimateCovariance(QueryState* state);

}  // namespace lazyloc

#pragma once

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// Fills the results' covariances from the last adjustment. Throws QueryFailure for frames whose position the image
// noise leaves open, and says what kind of view leaves it so.
void EstimateCovariance(QueryState* state);

}  // namespace lazyloc

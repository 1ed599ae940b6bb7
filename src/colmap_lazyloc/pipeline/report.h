#pragma once

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// Fills the result's pose, residuals of its pairs, points, their observations and reprojection errors.
void Report(QueryState* state);

}  // namespace lazyloc

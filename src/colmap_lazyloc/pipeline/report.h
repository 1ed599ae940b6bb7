#pragma once

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// Fills the results' poses, residuals of their pairs, points, their observations and reprojection errors.
void Report(QueryState* state);

}  // namespace lazyloc

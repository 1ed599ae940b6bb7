#pragma once

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// Rounds of triangulation and bundle adjustment from the start pose (LazyLoc, section 3.3), each with the noise of the
// images and of the database's poses that the one before has found. Throws QueryFailure where no pose comes of it.
void OptimizeOverTracks(QueryState* state);

}  // namespace lazyloc

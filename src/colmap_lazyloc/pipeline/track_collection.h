#pragma once

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// The observations of the pairs' inlier matches.
void ObserveMatches(QueryState* state);

// The tracks of the queries' keypoints over the pairs' inlier matches.
void CollectTracks(QueryState* state);

}  // namespace lazyloc

#pragma once

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// The observations of the pairs' inlier matches.
void ObserveMatches(QueryState* state);

// The tracks of the queries' keypoints over the pairs' inlier matches.
void CollectTracks(QueryState* state);

// The pairs' inliers again, from all their raw matches by the present poses, and the tracks over them.
void CollectTracksAgain(QueryState* state);

}  // namespace lazyloc

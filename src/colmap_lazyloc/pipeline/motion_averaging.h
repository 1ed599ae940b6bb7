#pragma once

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// LazyLoc, sections 3.1 and 3.2, with the database's poses fixed. Each stage needs those before it, and throws
// QueryFailure where the query cannot go on.

// The pairs' relative poses and inlier matches: stored, or estimated by COLMAP.
void FindRelativePoses(QueryState* state);
// Of more pairs than are wanted, keeps those with most inliers.
void KeepBestPairs(QueryState* state);
// The query's rotation; drops the pairs that do not agree with it.
void AverageRotation(QueryState* state);
// The pairs' directions of translation again, now that all rotations are known.
void EstimateDirections(QueryState* state);
// The query's position.
void AverageTranslation(QueryState* state);

}  // namespace lazyloc

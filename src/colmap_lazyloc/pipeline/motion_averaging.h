#pragma once

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// LazyLoc, sections 3.1 and 3.2, with the database's poses fixed. Each stage needs those before it, and throws
// QueryFailure where a frame cannot go on.

// The pairs' relative poses and inlier matches: stored, or estimated by COLMAP.
void FindRelativePoses(QueryState* state);
// Of more pairs of a query with database images than are wanted, keeps those with most inliers.
void KeepBestPairs(QueryState* state);
// Throws for frames that no pair links to the database or to another frame.
void CheckLinks(const QueryState& state);
// The frames' rotations; drops the pairs that do not agree with them.
void AverageRotation(QueryState* state);
// The pairs' directions of translation again, now that all rotations are known.
void EstimateDirections(QueryState* state);
// The frames' positions.
void AverageTranslation(QueryState* state);

}  // namespace lazyloc

#pragma once

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// Where the query's focal length is sought, these take the place of motion averaging: relative poses that were made
// with a wrong one must not decide. The query is alone in its group. Both throw QueryFailure where the query cannot go
// on.

// The pairs' inlier matches, however they were verified.
void CollectInlierMatches(QueryState* state);

// Of focal lengths between a third of and three times the given one, that under which COLMAP's absolute pose (P3P) on
// the points that the database views triangulate by themselves brings most of them near their image points, by the
// score of ChooseStart; and this pose. The given focal length's error does not reach these points.
void ChooseFocalLengthAndPose(QueryState* state);

}  // namespace lazyloc

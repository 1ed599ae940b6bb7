#pragma once

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// Sets the results' rig_error_px. Throws QueryFailure for frames of several images where one of them, taken by itself,
// fits the points that the database views triangulate far better than at its place in the frame: the calibration of the
// rig, or its trajectory, is wrong.
void CheckRigs(QueryState* state);

// The same before there are positions, for images none of whose pairs agree with the averaged rotations, but with each
// other. rotation_errors_rad: of the pairs.
void CheckRigRotations(const QueryState& state, const std::vector<double>& rotation_errors_rad, double max_error_deg);

}  // namespace lazyloc

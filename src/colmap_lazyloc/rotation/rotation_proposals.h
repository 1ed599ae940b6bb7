#pragma once

#include <vector>

#include "colmap_lazyloc/math/mean_rotation.h"
#include "colmap_lazyloc/rotation/rotation_averaging.h"

namespace lazyloc {

// The rotations that a node's edges propose for it, each from its other end, where that is known.
std::vector<WeightedRotation> ProposalsFor(int node, const RotationAveragingProblem& problem,
                                           const RotationAveragingResult& result);

// Grows from the known nodes outwards, always by the node whose best proposal has most support: the weight of all its
// proposals near that one, falling linearly to zero at max_error_rad.
void StartFromVotes(const RotationAveragingProblem& problem, double max_error_rad, RotationAveragingResult* result);

}  // namespace lazyloc

#pragma once

#include <vector>

#include "colmap_lazyloc/math/mean_rotation.h"
#include "colmap_lazyloc/rotation/rotation_averaging.h"

namespace lazyloc {

// Returns the rotations that a node's edges propose for it: each is computed from the other node, which must be known.
std::vector<WeightedRotation> ProposalsFor(int node, const RotationAveragingProblem& problem,
                                           const RotationAveragingResult& result);

// Sets start rotations of all nodes that are connected to a known one. Adds one node after another, always the one
// whose best proposal has the largest support. The support is the weight of all proposals of the node near that
// proposal; the weight falls linearly to zero at max_error_rad.
void StartFromVotes(const RotationAveragingProblem& problem, double max_error_rad, RotationAveragingResult* result);

}  // namespace lazyloc

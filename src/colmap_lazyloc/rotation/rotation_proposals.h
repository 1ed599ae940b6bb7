#pragma once

#include <vector>

#include "colmap_lazyloc/math/mean_rotation.h"
#include "colmap_lazyloc/rotation/rotation_averaging.h"

namespace lazyloc {

// Returns the indices of each node's edges.
std::vector<std::vector<size_t>> EdgesByNode(const RotationAveragingProblem& problem);

// Returns the rotations that a node's edges (indices `edges`) propose for it, one per edge whose other node is known.
std::vector<WeightedRotation> ProposalsFor(int node, const std::vector<size_t>& edges,
                                           const RotationAveragingProblem& problem,
                                           const RotationAveragingResult& result);

// Sets start rotations of all nodes that are connected to a known one. Adds one node after another, always the one
// whose best proposal has the largest support. The support is the weight of all proposals of the node near that
// proposal; the weight falls linearly to zero at kMaxRotationErrorDeg.
void StartFromVotes(const RotationAveragingProblem& problem, RotationAveragingResult* result);

}  // namespace lazyloc

#pragma once

#include "colmap_lazyloc/math/mean_rotation.h"
#include "colmap_lazyloc/rotation/rotation_averaging.h"

namespace lazyloc {

// Iterations end when no rotation changes by more: far below any measurement's noise, because an iteration is cheap.
inline constexpr double kRotationConvergenceDeg = 1e-10;

// Returns the error of an edge in the world frame, as a rotation vector in rad. If the world_from_cam rotations S of
// both nodes change by S <- exp(w) S, the error becomes error + w1 - w2 to first order. The error is expressed in the
// world frame because its Jacobian is then the incidence matrix of the graph, for all rotations.
Eigen::Vector3d EdgeErrorInWorld(const RotationEdge& edge, const std::vector<Eigen::Quaterniond>& rotations);

// Returns the indices of each node's edges.
std::vector<std::vector<size_t>> EdgesByNode(const RotationAveragingProblem& problem);

// Returns the rotations that a node's edges (indices `edges`) propose for it, one per edge whose other node is known.
std::vector<WeightedRotation> ProposalsFor(int node, const std::vector<size_t>& edges,
                                           const RotationAveragingProblem& problem,
                                           const RotationAveragingResult& result);

// Minimises the L1 norm of the edges' errors: the first part of AverageByL1Irls, as a RotationAverager.
void AverageByL1(const RotationAveragingProblem& problem, RotationAveragingResult* result);

}  // namespace lazyloc

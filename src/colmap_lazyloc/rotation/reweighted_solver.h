#pragma once

#include <functional>
#include <vector>

#include "colmap_lazyloc/rotation/rotation_averaging.h"

namespace lazyloc {

// Returns the error of an edge in the world frame, as a rotation vector in rad. If the world_from_cam rotations S of
// both nodes change by S <- exp(w) S, the error becomes error + w1 - w2 to first order. The error is expressed in the
// world frame because its Jacobian is then the incidence matrix of the graph, for all rotations.
Eigen::Vector3d EdgeErrorInWorld(const RotationEdge& edge, const std::vector<Eigen::Quaterniond>& rotations);

// Iteratively reweighted least squares (IRLS) over the known nodes that are not fixed. The three axes share the normal
// matrix of the weighted incidence matrix; each has a right-hand side. Chatterjee & Govindu, ICCV 2013.
class ReweightedSolver {
 public:
  ReweightedSolver(const RotationAveragingProblem& problem, RotationAveragingResult* result);

  // Iterates until no rotation changes by more than convergence_rad. weight_of: maps an edge's error in rad to its
  // robust weight.
  void Iterate(int max_iterations, double convergence_rad, const std::function<double(double)>& weight_of);

 private:
  // Solves the normal equations once and returns the largest change of a rotation, in rad.
  double Step(const std::function<double(double)>& weight_of);

  const RotationAveragingProblem& problem_;
  RotationAveragingResult& result_;
  std::vector<int> column_;  // column of each node in the normal matrix; -1 for a node that does not change
  int num_columns_ = 0;
};

}  // namespace lazyloc

#pragma once

#include <functional>
#include <vector>

#include "colmap_lazyloc/rotation/rotation_averaging.h"

namespace lazyloc {

// Error of an edge in the world: its unknowns enter as error + w1 - w2, where each world_from_cam rotation S moves as
// S <- exp(w) S. With this choice the Jacobian is the graph's incidence matrix, whatever the rotations are.
Eigen::Vector3d EdgeErrorInWorld(const RotationEdge& edge, const std::vector<Eigen::Quaterniond>& rotations);

// Iteratively reweighted least squares over the known nodes that are not fixed: the normal matrix of the weighted
// incidence matrix, one right-hand side per axis. Chatterjee & Govindu, ICCV 2013.
class ReweightedSolver {
 public:
  ReweightedSolver(const RotationAveragingProblem& problem, RotationAveragingResult* result);

  // Steps until no rotation moves by more than convergence_rad. weight_of(error in rad): an edge's robust weight.
  void Iterate(int max_iterations, double convergence_rad, const std::function<double(double)>& weight_of);

 private:
  // Returns the largest move of a node, in rad.
  double Step(const std::function<double(double)>& weight_of);

  const RotationAveragingProblem& problem_;
  RotationAveragingResult& result_;
  std::vector<int> column_;  // of each node; -1 where it does not move
  int num_columns_ = 0;
};

}  // namespace lazyloc

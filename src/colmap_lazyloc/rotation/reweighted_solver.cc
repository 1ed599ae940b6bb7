#include "colmap_lazyloc/rotation/reweighted_solver.h"

#include <Eigen/Sparse>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

// Adds an edge to the normal equations. A column of -1 belongs to a node that is fixed.
void AddEdge(int column1, int column2, double weight, const Eigen::Vector3d& error,
             std::vector<Eigen::Triplet<double>>* entries, Eigen::MatrixX3d* rhs) {
  if (column1 >= 0) {
    entries->emplace_back(column1, column1, weight);
    rhs->row(column1) -= weight * error.transpose();
  }
  if (column2 >= 0) {
    entries->emplace_back(column2, column2, weight);
    rhs->row(column2) += weight * error.transpose();
  }
  if (column1 >= 0 && column2 >= 0) {
    entries->emplace_back(column1, column2, -weight);
    entries->emplace_back(column2, column1, -weight);
  }
}

}  // namespace

Eigen::Vector3d EdgeErrorInWorld(const RotationEdge& edge, const std::vector<Eigen::Quaterniond>& rotations) {
  const Eigen::Quaterniond world_from_node2_measured =
      rotations[edge.node1].conjugate() * edge.node2_from_node1.conjugate();
  return LogSO3(world_from_node2_measured * rotations[edge.node2]);
}

ReweightedSolver::ReweightedSolver(const RotationAveragingProblem& problem, RotationAveragingResult* result)
    : problem_(problem), result_(*result), column_(problem.is_fixed.size(), -1) {
  for (size_t node = 0; node < problem.is_fixed.size(); ++node) {
    if (result->is_known[node] && !problem.is_fixed[node]) column_[node] = num_columns_++;
  }
}

void ReweightedSolver::Iterate(int max_iterations, double convergence_rad,
                               const std::function<double(double)>& weight_of) {
  for (int i = 0; i < max_iterations; ++i) {
    ++result_.summary.iterations;
    if (Step(weight_of) < convergence_rad) return;
  }
}

double ReweightedSolver::Step(const std::function<double(double)>& weight_of) {
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::MatrixX3d rhs = Eigen::MatrixX3d::Zero(num_columns_, 3);
  for (const RotationEdge& edge : problem_.edges) {
    if (!result_.is_known[edge.node1] || !result_.is_known[edge.node2]) continue;
    const Eigen::Vector3d error = EdgeErrorInWorld(edge, result_.rotations);
    AddEdge(column_[edge.node1], column_[edge.node2], edge.weight * weight_of(error.norm()), error, &entries, &rhs);
  }
  Eigen::SparseMatrix<double> normal(num_columns_, num_columns_);
  normal.setFromTriplets(entries.begin(), entries.end());
  const Eigen::MatrixX3d moves = Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>(normal).solve(rhs);
  for (size_t node = 0; node < column_.size(); ++node) {
    if (column_[node] < 0) continue;
    const Eigen::Quaterniond world_move = ExpSO3(moves.row(column_[node]).transpose());
    result_.rotations[node] = (result_.rotations[node] * world_move.conjugate()).normalized();
  }
  return moves.rowwise().norm().maxCoeff();
}

}  // namespace lazyloc

#include <Eigen/Sparse>

#include "colmap_lazyloc/math/robust_weights.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/rotation/rotation_methods.h"

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

// Runs iteratively reweighted least squares (IRLS) over the known nodes that are not fixed, until no rotation changes.
// The three axes share the normal matrix of the weighted incidence matrix; each has a right-hand side. weight_of: maps
// an edge's error in rad to its robust weight. Chatterjee & Govindu, ICCV 2013.
template <typename Weight>
void Iterate(const RotationAveragingProblem& problem, int max_iterations, RotationAveragingResult* result,
             const Weight& weight_of) {
  std::vector<int> column_of(problem.is_fixed.size(), -1);
  int num_columns = 0;
  for (size_t node = 0; node < column_of.size(); ++node) {
    if (result->is_known[node] && !problem.is_fixed[node]) column_of[node] = num_columns++;
  }
  for (int i = 0; i < max_iterations; ++i) {
    std::vector<Eigen::Triplet<double>> entries;
    Eigen::MatrixX3d rhs = Eigen::MatrixX3d::Zero(num_columns, 3);
    for (const RotationEdge& edge : problem.edges) {
      if (!result->is_known[edge.node1] || !result->is_known[edge.node2]) continue;
      const Eigen::Vector3d error = EdgeErrorInWorld(edge, result->rotations);
      AddEdge(column_of[edge.node1], column_of[edge.node2], edge.weight * weight_of(error.norm()), error, &entries,
              &rhs);
    }
    Eigen::SparseMatrix<double> normal(num_columns, num_columns);
    normal.setFromTriplets(entries.begin(), entries.end());
    const Eigen::MatrixX3d moves = Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>(normal).solve(rhs);
    for (size_t node = 0; node < column_of.size(); ++node) {
      if (column_of[node] < 0) continue;
      const Eigen::Quaterniond world_move = ExpSO3(moves.row(column_of[node]).transpose());
      result->rotations[node] = (result->rotations[node] * world_move.conjugate()).normalized();
    }
    if (moves.rowwise().norm().maxCoeff() < DegToRad(kRotationConvergenceDeg)) return;
  }
}

}  // namespace

// Minimises the L1 norm of the edges' errors, because outliers change its minimum only slightly.
void AverageByL1(const RotationAveragingProblem& problem, RotationAveragingResult* result) {
  constexpr int kNumIterations = 10;  // enough for the basin of the next, redescending cost
  const double floor_rad = DegToRad(0.1);
  Iterate(problem, kNumIterations, result, [=](double error) { return L1Weight(error, floor_rad); });
}

// Runs L1 steps before IRLS, because the redescending loss needs a start in the basin of its global minimum. Chatterjee
// & Govindu, algorithm 1.
void AverageByL1Irls(const RotationAveragingProblem& problem, RotationAveragingResult* result) {
  AverageByL1(problem, result);
  constexpr int kNumIterations = 20;
  // Take twice the error of a good pair as the loss's scale, so that a pair that is off by 5 deg hardly counts.
  constexpr double kScaleDeg = 2;
  const double scale_rad = DegToRad(kScaleDeg);
  Iterate(problem, kNumIterations, result, [=](double error) { return GemanMcClureWeight(error * error, scale_rad); });
}

}  // namespace lazyloc

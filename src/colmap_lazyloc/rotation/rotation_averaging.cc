#include "colmap_lazyloc/rotation/rotation_averaging.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include <Eigen/Sparse>

#include "colmap_lazyloc/math/robust_weights.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

// A rotation that an edge proposes for an unknown node, from its other end.
struct Proposal {
  Eigen::Quaterniond rotation;
  double weight;
};

std::vector<Proposal> ProposalsFor(int node, const RotationAveragingProblem& problem,
                                   const RotationAveragingResult& result) {
  std::vector<Proposal> proposals;
  for (const RotationEdge& edge : problem.edges) {
    if (edge.node2 == node && result.is_known[edge.node1]) {
      proposals.push_back({edge.node2_from_node1 * result.rotations[edge.node1], edge.weight});
    } else if (edge.node1 == node && result.is_known[edge.node2]) {
      proposals.push_back({edge.node2_from_node1.conjugate() * result.rotations[edge.node2], edge.weight});
    }
  }
  return proposals;
}

// Weight of all proposals near one of them, falling linearly to zero at max_error_rad.
double Support(const Proposal& proposal, const std::vector<Proposal>& all, double max_error_rad) {
  double support = 0;
  for (const Proposal& other : all) {
    const double error = AngularDistanceRad(proposal.rotation, other.rotation);
    support += other.weight * std::max(0.0, 1 - error / max_error_rad);
  }
  return support;
}

// Grows from the fixed nodes outwards, always by the node whose best proposal has most support.
void StartFromVotes(const RotationAveragingProblem& problem, double max_error_rad, RotationAveragingResult* result) {
  while (true) {
    int best_node = -1;
    double best_support = 0;
    Eigen::Quaterniond best_rotation;
    for (int node = 0; node < static_cast<int>(problem.is_fixed.size()); ++node) {
      if (result->is_known[node]) continue;
      const std::vector<Proposal> proposals = ProposalsFor(node, problem, *result);
      for (const Proposal& proposal : proposals) {
        const double support = Support(proposal, proposals, max_error_rad);
        if (support > best_support) {
          best_node = node;
          best_support = support;
          best_rotation = proposal.rotation;
        }
      }
    }
    if (best_node < 0) return;
    result->rotations[best_node] = best_rotation.normalized();
    result->is_known[best_node] = true;
  }
}

// Error of an edge in the world: its unknowns enter as error + w1 - w2, where each world_from_cam rotation S moves as
// S <- exp(w) S. With this choice the Jacobian is the graph's incidence matrix, whatever the rotations are.
Eigen::Vector3d EdgeErrorInWorld(const RotationEdge& edge, const std::vector<Eigen::Quaterniond>& rotations) {
  const Eigen::Quaterniond world_from_node2_measured =
      rotations[edge.node1].conjugate() * edge.node2_from_node1.conjugate();
  return LogSO3(world_from_node2_measured * rotations[edge.node2]);
}

// The system of the unknown nodes: normal matrix of the weighted incidence matrix, one right-hand side per axis.
class ReweightedSolver {
 public:
  ReweightedSolver(const RotationAveragingProblem& problem, RotationAveragingResult* result)
      : problem_(problem), result_(*result), column_(problem.is_fixed.size(), -1) {
    for (size_t node = 0; node < problem.is_fixed.size(); ++node) {
      if (result->is_known[node] && !problem.is_fixed[node]) column_[node] = num_columns_++;
    }
  }

  // weight_of(error in rad): the robust weight of an edge. Returns the largest move of a node, in rad.
  double Step(const std::function<double(double)>& weight_of) {
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

 private:
  static void AddEdge(int column1, int column2, double weight, const Eigen::Vector3d& error,
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

  const RotationAveragingProblem& problem_;
  RotationAveragingResult& result_;
  std::vector<int> column_;
  int num_columns_ = 0;
};

void ComputeEdgeErrors(const RotationAveragingProblem& problem, RotationAveragingResult* result) {
  for (const RotationEdge& edge : problem.edges) {
    const bool known = result->is_known[edge.node1] && result->is_known[edge.node2];
    result->edge_errors_rad.push_back(known ? EdgeErrorInWorld(edge, result->rotations).norm()
                                            : std::numeric_limits<double>::quiet_NaN());
  }
}

}  // namespace

bool RotationAveragingOptions::Check(std::string* error) const {
  OPTION_GT(vote_error_deg, 0);
  OPTION_GE(num_l1_iterations, 0);
  OPTION_GE(num_irls_iterations, 0);
  OPTION_GT(irls_scale_deg, 0);
  OPTION_GT(convergence_deg, 0);
  return true;
}

RotationAveragingResult AverageRotations(const RotationAveragingProblem& problem,
                                         const RotationAveragingOptions& options) {
  LAZYLOC_CHECK(problem.rotations.size() == problem.is_fixed.size());
  RotationAveragingResult result;
  result.rotations = problem.rotations;
  result.is_known = problem.is_fixed;
  StartFromVotes(problem, DegToRad(options.vote_error_deg), &result);
  if (result.is_known == problem.is_fixed) {
    result.summary.message = "no unknown rotation is linked to a fixed one";
    return result;
  }

  // Chatterjee & Govindu, algorithm 1: L1 steps bring the start into the basin of the redescending cost.
  const double floor_rad = DegToRad(0.1);
  const double scale_rad = DegToRad(options.irls_scale_deg);
  const double convergence_rad = DegToRad(options.convergence_deg);
  const auto l1 = [&](double error) { return L1Weight(error, floor_rad); };
  const auto geman_mcclure = [&](double error) { return GemanMcClureWeight(error * error, scale_rad); };
  ReweightedSolver solver(problem, &result);
  const auto iterate = [&](int max_iterations, const std::function<double(double)>& weight_of) {
    for (int i = 0; i < max_iterations; ++i) {
      ++result.summary.iterations;
      if (solver.Step(weight_of) < convergence_rad) return;
    }
  };
  iterate(options.num_l1_iterations, l1);
  iterate(options.num_irls_iterations, geman_mcclure);

  ComputeEdgeErrors(problem, &result);
  result.summary.success = true;
  result.summary.message = "averaged";
  return result;
}

}  // namespace lazyloc

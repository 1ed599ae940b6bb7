#include <algorithm>
#include <utility>

#include <Eigen/Cholesky>

#include "averaging_methods.h"
#include "colmap_lazyloc/math/robust_weights.h"
#include "colmap_lazyloc/translation/translation_methods.h"

namespace lazyloc {
namespace {

// Iteratively reweighted least squares for least unsquared deviations (LUD).
class LudSolver {
 public:
  LudSolver(const TranslationAveragingProblem& problem, const TranslationAveragingResult& result)
      : offsets_(problem.is_fixed.size(), -1), centres_(result.cams_in_world) {
    for (size_t node = 0; node < offsets_.size(); ++node) {
      if (!result.is_known[node] || problem.is_fixed[node]) continue;
      offsets_[node] = size_;
      size_ += 3;
    }
    for (const DirectionEdge& edge : problem.edges) {
      const bool is_known = result.is_known[edge.node1] && result.is_known[edge.node2];
      if (!is_known || (problem.is_fixed[edge.node1] && problem.is_fixed[edge.node2])) continue;
      edges_.push_back(edge);
      length_ += Baseline(edge, centres_).norm() / static_cast<double>(problem.edges.size());
    }
  }

  StageSummary Minimize(int max_num_iterations) {
    StageSummary summary = {true, "no convergence", 0, Cost(centres_)};
    for (; summary.iterations < max_num_iterations; ++summary.iterations) {
      Eigen::VectorXd step = Step();
      std::vector<Eigen::Vector3d> next = Moved(step);
      // Halves the step while the cost increases, because an edge may have changed between lambda > 0 and lambda = 0.
      // Tolerates 1e-12, because rounding is larger than the decrease near the minimum.
      const double max_cost = summary.cost * (1 + 1e-12);
      for (int halving = 0; halving < 20 && Cost(next) > max_cost; ++halving) next = Moved(step /= 2);
      if (!(Cost(next) <= max_cost)) {
        summary.message = "no step lowers the cost";
        break;
      }
      summary.cost = Cost(next);
      centres_ = next;
      if (step.norm() > 1e-12 * length_) continue;
      summary.message = "converged";
      break;
    }
    return summary;
  }

  const std::vector<Eigen::Vector3d>& Centres() const { return centres_; }

 private:
  // Returns the baseline minus the closest point lambda dir, lambda >= 0.
  static Eigen::Vector3d Deviation(const DirectionEdge& edge, const std::vector<Eigen::Vector3d>& centres) {
    const Eigen::Vector3d baseline = Baseline(edge, centres);
    return baseline - std::max(0.0, baseline.dot(edge.dir_1to2_in_world)) * edge.dir_1to2_in_world;
  }

  double Cost(const std::vector<Eigen::Vector3d>& centres) const {
    double cost = 0;
    for (const DirectionEdge& edge : edges_) cost += Deviation(edge, centres).norm();
    return cost;
  }

  // Solves the reweighted normal equations, from which each lambda is eliminated.
  Eigen::VectorXd Step() const {
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(size_, size_);
    Eigen::VectorXd rhs = Eigen::VectorXd::Zero(size_);
    for (const DirectionEdge& edge : edges_) {
      const Eigen::Vector3d& dir = edge.dir_1to2_in_world;
      const Eigen::Vector3d deviation = Deviation(edge, centres_);
      const double weight = L1Weight(deviation.norm(), 1e-8 * length_);
      Eigen::Matrix3d block = weight * Eigen::Matrix3d::Identity();
      if (Baseline(edge, centres_).dot(dir) > 0) block -= weight * dir * dir.transpose();
      const int offset1 = offsets_[edge.node1], offset2 = offsets_[edge.node2];
      for (const auto& [offset, sign] : {std::pair{offset1, 1.0}, std::pair{offset2, -1.0}}) {
        if (offset < 0) continue;
        normal.block<3, 3>(offset, offset) += block;
        rhs.segment<3>(offset) += sign * weight * deviation;
      }
      if (offset1 < 0 || offset2 < 0) continue;
      normal.block<3, 3>(offset1, offset2) -= block;
      normal.block<3, 3>(offset2, offset1) -= block;
    }
    // Regularises the diagonal, so that a position that is unobservable along a line keeps its start on the line.
    normal.diagonal().array() += 1e-9 * normal.diagonal().maxCoeff();
    return normal.ldlt().solve(rhs);
  }

  std::vector<Eigen::Vector3d> Moved(const Eigen::VectorXd& step) const {
    std::vector<Eigen::Vector3d> centres = centres_;
    for (size_t node = 0; node < centres.size(); ++node) {
      if (offsets_[node] >= 0) centres[node] += step.segment<3>(offsets_[node]);
    }
    return centres;
  }

  std::vector<int> offsets_;  // first of a centre's three rows in the linear system; -1 if it is fixed or not known
  int size_ = 0;              // of the linear system
  std::vector<DirectionEdge> edges_;  // edges with at least one centre that is not fixed
  std::vector<Eigen::Vector3d> centres_;
  double length_ = 0;  // typical baseline; unit of the convergence threshold and of the floor of deviations
};

}  // namespace

void AverageByLeastUnsquaredDeviations(const TranslationAveragingProblem& problem, TranslationAveragingResult* result) {
  LudSolver solver(problem, *result);
  result->summary = solver.Minimize(kMaxNumTranslationIterations);
  result->cams_in_world = solver.Centres();
}

}  // namespace lazyloc

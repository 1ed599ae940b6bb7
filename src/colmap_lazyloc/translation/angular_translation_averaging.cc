#include <ceres/ceres.h>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/translation/translation_methods.h"

namespace lazyloc {
namespace {

// Residual (u - dir) / sigma, with u = b / |b| and b = C2 - C1 + offset. Parameters: the centres C1 and C2.
class ChordCost : public ceres::SizedCostFunction<3, 3, 3> {
 public:
  ChordCost(const DirectionEdge& edge, double stddev)
      : dir_(edge.dir_1to2_in_world), offset_(edge.offset_in_world), weight_(1 / stddev) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Eigen::Vector3d baseline =
        Eigen::Map<const Eigen::Vector3d>(parameters[1]) - Eigen::Map<const Eigen::Vector3d>(parameters[0]) + offset_;
    const double length = baseline.norm();
    if (length == 0) return false;
    const Eigen::Vector3d unit = baseline / length;
    Eigen::Map<Eigen::Vector3d> residual(residuals);
    residual = weight_ * (unit - dir_);
    if (jacobians == nullptr) return true;
    const Eigen::Matrix3d jacobian = weight_ / length * (Eigen::Matrix3d::Identity() - unit * unit.transpose());
    // Needs no conversion to Ceres' row-major order, because the Jacobian is symmetric.
    for (int i = 0; i < 2; ++i) {
      if (jacobians[i] == nullptr) continue;
      Eigen::Map<Eigen::Matrix3d> target(jacobians[i]);
      target = i == 0 ? -jacobian : jacobian;
    }
    return true;
  }

 private:
  const Eigen::Vector3d dir_, offset_;
  const double weight_;
};

}  // namespace

void AverageByAngles(const TranslationAveragingProblem& problem, TranslationAveragingResult* result) {
  ceres::CauchyLoss loss(kLossScaleSigma);
  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem ceres_problem(problem_options);
  for (const DirectionEdge& edge : problem.edges) {
    if (!result->is_known[edge.node1] || !result->is_known[edge.node2]) continue;
    if (problem.is_fixed[edge.node1] && problem.is_fixed[edge.node2]) continue;
    ceres_problem.AddResidualBlock(new ChordCost(edge, EdgeStddevRad(edge)), &loss,
                                   result->cams_in_world[edge.node1].data(), result->cams_in_world[edge.node2].data());
    for (const int node : {edge.node1, edge.node2}) {
      if (problem.is_fixed[node]) ceres_problem.SetParameterBlockConstant(result->cams_in_world[node].data());
    }
  }
  ceres::Solver::Options solver_options;
  solver_options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  if (ceres_problem.NumResidualBlocks() <= 200) solver_options.linear_solver_type = ceres::DENSE_QR;
  solver_options.max_num_iterations = kMaxNumTranslationIterations;
  solver_options.function_tolerance = 1e-14;
  solver_options.gradient_tolerance = 1e-14;
  solver_options.parameter_tolerance = 1e-12;
  solver_options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver_options, &ceres_problem, &summary);
  result->summary.success = summary.IsSolutionUsable();
  result->summary.message = summary.message;
}

}  // namespace lazyloc

#include "colmap_lazyloc/refinement/bundle_adjustment.h"

#include <ceres/ceres.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/linear_projection.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

using Matrix2x3RowMajor = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;

// A pose is 7 numbers, quaternion x y z w and translation, and moves by the left perturbation (w, dt): R <- ExpSO3(w) R,
// t <- t + dt. The costs give their derivatives with respect to (w, dt) in the first six columns, and PlusJacobian lets
// these through: no detour over the quaternion's four numbers.
class PoseManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    const Eigen::Map<const Eigen::Quaterniond> rotation(x);
    const Eigen::Map<const Eigen::Vector3d> w(delta), translation_delta(delta + 3), translation(x + 4);
    Eigen::Map<Eigen::Quaterniond> new_rotation(x_plus_delta);
    Eigen::Map<Eigen::Vector3d> new_translation(x_plus_delta + 4);
    new_rotation = (ExpSO3(w) * rotation).normalized();
    new_translation = translation + translation_delta;
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>> matrix(jacobian);
    matrix.setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* y_minus_x) const override {
    const Eigen::Map<const Eigen::Quaterniond> rotation_y(y), rotation_x(x);
    const Eigen::Map<const Eigen::Vector3d> translation_y(y + 4), translation_x(x + 4);
    Eigen::Map<Eigen::Matrix<double, 6, 1>> delta(y_minus_x);
    delta << LogSO3(rotation_y * rotation_x.conjugate()), translation_y - translation_x;
    return true;
  }
  bool MinusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>> matrix(jacobian);
    matrix.setIdentity();
    return true;
  }
};

// A point seen by a fixed view: parameters point_in_world.
class FixedViewCost : public ceres::SizedCostFunction<2, 3> {
 public:
  explicit FixedViewCost(const LinearProjection& projection) : projection_(projection) {}
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    Eigen::Matrix<double, 2, 3> jacobian;
    const Eigen::Map<const Eigen::Vector3d> point(parameters[0]);
    Eigen::Map<Eigen::Vector2d> residual(residuals);
    residual = projection_.Error(point, &jacobian);
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      Eigen::Map<Matrix2x3RowMajor> point_jacobian(jacobians[0]);
      point_jacobian = jacobian;
    }
    return true;
  }

 private:
  const LinearProjection projection_;
};

// A point seen by a view whose pose is sought: parameters pose, point_in_world.
class FreeViewCost : public ceres::SizedCostFunction<2, 7, 3> {
 public:
  explicit FreeViewCost(const Observation& observation) : projection_(ProjectionInCam(observation)) {}
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Eigen::Map<const Eigen::Quaterniond> rotation(parameters[0]);
    const Eigen::Map<const Eigen::Vector3d> translation(parameters[0] + 4), point(parameters[1]);
    const Eigen::Matrix3d cam_from_world_rotation = rotation.toRotationMatrix();
    const Eigen::Vector3d rotated = cam_from_world_rotation * point;
    Eigen::Matrix<double, 2, 3> jacobian;
    Eigen::Map<Eigen::Vector2d> residual(residuals);
    residual = projection_.Error(rotated + translation, &jacobian);
    if (jacobians == nullptr) return true;
    if (jacobians[0] != nullptr) {
      Eigen::Map<Eigen::Matrix<double, 2, 7, Eigen::RowMajor>> pose_jacobian(jacobians[0]);
      pose_jacobian << -jacobian * Hat(rotated), jacobian, Eigen::Vector2d::Zero();
    }
    if (jacobians[1] != nullptr) {
      Eigen::Map<Matrix2x3RowMajor> point_jacobian(jacobians[1]);
      point_jacobian = jacobian * cam_from_world_rotation;
    }
    return true;
  }

 private:
  const LinearProjection projection_;
};

// The solver's copy of a pose.
struct PoseBlock {
  double values[7];
  explicit PoseBlock(const Rigid3d& pose) {
    Eigen::Map<Eigen::Matrix<double, 7, 1>> vector(values);
    vector << pose.rotation.coeffs(), pose.translation;
  }
  Rigid3d Pose() const {
    return {Eigen::Quaterniond(Eigen::Map<const Eigen::Quaterniond>(values)),
            Eigen::Vector3d(Eigen::Map<const Eigen::Vector3d>(values + 4))};
  }
};

}  // namespace

bool BundleAdjustmentOptions::Check(std::string* error) const {
  OPTION_GT(loss_scale_px, 0);
  OPTION_GE(max_num_iterations, 1);
  OPTION_GE(function_tolerance, 0);
  return true;
}

StageSummary AdjustBundle(const BundleAdjustmentOptions& options, std::vector<View>* views, std::vector<Track>* tracks) {
  ceres::CauchyLoss loss(options.loss_scale_px);
  PoseManifold manifold;
  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(problem_options);
  std::vector<PoseBlock> poses;
  for (const View& view : *views) poses.emplace_back(view.cam_from_world);
  auto* ordering = new ceres::ParameterBlockOrdering;
  for (Track& track : *tracks) {
    double* point = track.point_in_world.data();
    for (const TrackObservation& element : track.observations) {
      const View& view = (*views)[element.view];
      if (view.is_fixed) {
        problem.AddResidualBlock(new FixedViewCost(ProjectionInWorld(element.observation, view.cam_from_world)), &loss,
                                 point);
      } else {
        problem.AddResidualBlock(new FreeViewCost(element.observation), &loss, poses[element.view].values, point);
      }
    }
    ordering->AddElementToGroup(point, 0);
  }
  for (size_t i = 0; i < views->size(); ++i) {
    if (!problem.HasParameterBlock(poses[i].values)) continue;
    problem.SetManifold(poses[i].values, &manifold);
    ordering->AddElementToGroup(poses[i].values, 1);
  }

  ceres::Solver::Options solver_options;
  solver_options.linear_solver_ordering.reset(ordering);
  solver_options.linear_solver_type = ceres::DENSE_SCHUR;
  solver_options.max_num_iterations = options.max_num_iterations;
  solver_options.function_tolerance = options.function_tolerance;
  solver_options.gradient_tolerance = 1e-12;
  solver_options.parameter_tolerance = 1e-12;
  solver_options.num_threads = 1;
  solver_options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver_options, &problem, &summary);
  for (size_t i = 0; i < views->size(); ++i) {
    if (!(*views)[i].is_fixed) (*views)[i].cam_from_world = poses[i].Pose();
  }
  return {summary.IsSolutionUsable(), summary.message, static_cast<int>(summary.iterations.size()), summary.final_cost};
}

}  // namespace lazyloc

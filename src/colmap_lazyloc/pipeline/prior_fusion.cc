#include "colmap_lazyloc/pipeline/prior_fusion.h"

#include <cmath>

#include <Eigen/Cholesky>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/prior_comparison.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/refinement/query_prior_residual.h"

namespace lazyloc {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

// Up to three residuals of a prior in its standard deviations, and their derivative by the tangent of the pose.
struct Equations {
  Vector6 errors = Vector6::Zero();
  Matrix6 jacobian = Matrix6::Zero();

  void Set(int row, const QueryPriorResidual& residual) {
    errors.segment<3>(row) = residual.error;
    jacobian.middleRows<3>(row) = residual.jacobian.leftCols<6>();
  }
};

// Compares the priors with a pose of this covariance, and returns the equations of those that are used. The camera is
// at the origin, because small covariances of positions would be lost in large coordinates.
Equations UsedEquations(QueryPrior prior, const Eigen::Quaterniond& rotation, const Matrix6& covariance,
                        QueryPriorResult* result) {
  const Rigid3d pose{rotation, Eigen::Vector3d::Zero()};
  Equations equations;
  if (prior.position) {
    prior.position->covariance *= ComparePosition(*prior.position, pose, covariance, &*result->position);
    if (result->position->verdict == PriorVerdict::USED) {
      equations.Set(0, EvaluatePositionPrior(*prior.position, {}, pose));
    }
  }
  if (prior.gravity) {
    prior.gravity->stddev_rad *=
        std::sqrt(CompareGravity(*prior.gravity, rotation, covariance.topLeftCorner<3, 3>(), &*result->gravity));
    if (result->gravity->verdict == PriorVerdict::USED) {
      equations.Set(3, EvaluateGravityPrior(*prior.gravity, {}, pose));
    }
  }
  return equations;
}

bool IsUntested(const QueryPriorResult& result) {
  return (!result.position || result.position->verdict == PriorVerdict::NOT_TESTED) &&
         (!result.gravity || result.gravity->verdict == PriorVerdict::NOT_TESTED);
}

void FusePriorsOf(const Layout& layout, int query, QueryPriorResult* result, CheckedIntrinsics* checked) {
  Rigid3d& pose = checked->posed.frames[layout.FrameOf(query)].frame_from_world;
  PoseUncertainty& uncertainty = checked->uncertainties[query];
  const Eigen::Vector3d centre = CamInWorld(pose);
  const Matrix6 around_camera = TangentFromAround(-(centre + layout.origin), pose.rotation);
  const Matrix6 covariance = around_camera * uncertainty.covariance * around_camera.transpose();
  QueryPrior prior = layout.priors[query];
  if (prior.position) prior.position->position -= centre;
  const Equations equations = UsedEquations(prior, pose.rotation, covariance, result);
  if (equations.jacobian.isZero(0)) return;

  FocalLengthError& focal = checked->focal_errors[query];
  const Vector6 by_focal = around_camera * focal.pose_from_log_focal;
  const Matrix6 of_focal = focal.mean_square * by_focal * by_focal.transpose();
  const Matrix6 of_images = covariance - of_focal;
  // Update like a Kalman filter. Priors that are not used have zero rows, to which the identity gives no weight.
  const Matrix6 of_errors = equations.jacobian * of_images * equations.jacobian.transpose() + Matrix6::Identity();
  const Matrix6 gain = of_errors.ldlt().solve(equations.jacobian * of_images).transpose();
  const Vector6 step = -gain * equations.errors;
  const Matrix6 kept = Matrix6::Identity() - gain * equations.jacobian;
  const Eigen::Quaterniond rotation = (ExpSO3(step.head<3>()) * pose.rotation).normalized();
  pose = CamFromWorld(rotation, centre - rotation.conjugate() * step.tail<3>());

  const Matrix6 fused = kept * covariance * kept.transpose() + gain * gain.transpose();
  const Eigen::Vector3d centre_in_world = CamInWorld(pose) + layout.origin;
  uncertainty.covariance = CovarianceFromAround(centre_in_world, rotation, (fused + fused.transpose()) / 2);
  uncertainty.spread = ComputePoseSpread({rotation, Eigen::Vector3d::Zero()}, fused);
  focal.pose_from_log_focal = TangentFromAround(centre_in_world, rotation) * kept * by_focal;
}

}  // namespace

bool IsFused(const Layout& layout, const PosedImages& posed, int query) {
  const int frame = layout.FrameOf(query);
  return layout.QueriesOf(frame).size() == 1 && !posed.images[query].log_focal_factor;
}

void FusePriors(const Layout& layout, std::vector<QueryPriorResult>* results, CheckedIntrinsics* checked) {
  for (int query = 0; query < layout.num_queries; ++query) {
    const QueryPrior& prior = layout.priors[query];
    if ((!prior.position && !prior.gravity) || !IsFused(layout, checked->posed, query)) continue;
    QueryPriorResult& result = (*results)[query];
    if (IsUntested(result)) FusePriorsOf(layout, query, &result, checked);
  }
}

}  // namespace lazyloc

#include "colmap_lazyloc/refinement/rig_tolerance.h"

#include <cmath>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

// Returns the derivative of source_from_target * p, for the centre p = 0 of the target, with respect to the tangent of
// target_from_source.
Eigen::Matrix<double, 3, 6> CentreByTangent(const Rigid3d& target_from_source) {
  Eigen::Matrix<double, 3, 6> jacobian;
  jacobian << Hat(target_from_source.translation), Eigen::Matrix3d::Identity();
  return -target_from_source.rotation.conjugate().toRotationMatrix() * jacobian;
}

}  // namespace

RigToleranceResidual EvaluateRigTolerance(const Calibration& calibration, const Rigid3d& cam_from_frame,
                                          std::optional<double> log_scale, const Rigid3d& cam_from_world,
                                          const Rigid3d& frame_from_world) {
  RigToleranceResidual residual;
  const Eigen::Quaterniond rotation = cam_from_world.rotation * frame_from_world.rotation.conjugate();
  const double scale = std::exp(log_scale.value_or(0));
  const Eigen::Vector3d scaled_centre = scale * CamInWorld(cam_from_frame);
  const Eigen::Vector3d rotated_centre = frame_from_world.rotation * CamInWorld(cam_from_world);
  residual.error << LogSO3(rotation * cam_from_frame.rotation.conjugate()),
      rotated_centre + frame_from_world.translation - scaled_centre;
  // The jacobians are exact to first order in the rotation's deviation.
  const Eigen::Matrix3d identity = Eigen::Matrix3d::Identity(), zero = Eigen::Matrix3d::Zero();
  residual.by_cam.leftCols<6>() << identity, zero,
      frame_from_world.rotation.toRotationMatrix() * CentreByTangent(cam_from_world);
  residual.by_frame.leftCols<6>() << -rotation.toRotationMatrix(), zero, -Hat(rotated_centre), identity;
  residual.by_calibration.leftCols<6>() << -identity, zero, -scale * CentreByTangent(cam_from_frame);
  if (log_scale) residual.by_frame.col(6).tail<3>() = -scaled_centre;
  Eigen::Matrix<double, 6, 1> weights;
  weights << Eigen::Vector3d::Constant(1 / calibration.flex_rad),
      Eigen::Vector3d::Constant(1 / calibration.flex_length);
  residual.error.array() *= weights.array();
  for (auto* jacobian : {&residual.by_cam, &residual.by_frame, &residual.by_calibration}) {
    *jacobian = weights.asDiagonal() * *jacobian;
  }
  return residual;
}

}  // namespace lazyloc

#include "colmap_lazyloc/scene/pose_distribution.h"

#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

using Matrix = PoseDistribution::Matrix;

// Returns the derivative of a tangent by that of the same pose in coordinates in which the translation is less by
// `shift`.
Matrix AfterShift(const Eigen::Vector3d& shift) {
  Matrix derivative = Matrix::Identity();
  derivative.bottomLeftCorner<3, 3>() = -Hat(shift);
  return derivative;
}

Matrix Symmetric(const Matrix& matrix) { return (matrix + matrix.transpose()) / 2; }

}  // namespace

Matrix AroundCamera(const Rigid3d& cam_from_world) { return AfterShift(-cam_from_world.translation); }

PoseDistribution MakePoseDistribution(const Rigid3d& cam_from_world, const Matrix& covariance) {
  const Matrix around_camera = AroundCamera(cam_from_world);
  PoseDistribution pose{cam_from_world};
  pose.of_images = Symmetric(around_camera * covariance * around_camera.transpose());
  return pose;
}

PoseDistribution MakePoseDistribution(const Rigid3d& cam_from_world, const Eigen::Matrix3d& rotation_covariance,
                                      const Eigen::Matrix3d& position_covariance) {
  const Eigen::Matrix3d rotation = cam_from_world.rotation.toRotationMatrix();
  PoseDistribution pose{cam_from_world};
  pose.of_images.topLeftCorner<3, 3>() = rotation_covariance;
  pose.of_images.bottomRightCorner<3, 3>() = rotation * position_covariance * rotation.transpose();
  return pose;
}

Matrix PoseDistribution::Covariance() const {
  return of_images + log_focal_variance * by_log_focal * by_log_focal.transpose();
}

Matrix PoseDistribution::CovarianceAt(const Eigen::Vector3d& translation) const {
  const Matrix derivative = AfterShift(translation);
  return Symmetric(derivative * Covariance() * derivative.transpose());
}

Eigen::Matrix3d PoseDistribution::PositionCovariance() const {
  const Eigen::Matrix3d world_from_cam = cam_from_world.rotation.conjugate().toRotationMatrix();
  return world_from_cam * Covariance().bottomRightCorner<3, 3>() * world_from_cam.transpose();
}

Matrix PoseDistribution::CovarianceInWorld() const {
  // Around the camera, the tangent (w, t) moves the centre by -R^T t. With R <- exp(w) R, the inverse rotation becomes
  // R^T exp(-w) = exp(-R^T w) R^T.
  Matrix derivative = Matrix::Zero();
  derivative.topRightCorner<3, 3>() = -cam_from_world.rotation.conjugate().toRotationMatrix();
  derivative.bottomLeftCorner<3, 3>() = derivative.topRightCorner<3, 3>();
  return Symmetric(derivative * Covariance() * derivative.transpose());
}

PoseSpread PoseDistribution::Spread() const {
  using Solver = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>;
  const Solver rotation(RotationCovariance(), Eigen::EigenvaluesOnly), position(PositionCovariance());
  PoseSpread spread;
  spread.rotation_stddev_rad = std::sqrt(rotation.eigenvalues()[2]);
  spread.position_stddevs = position.eigenvalues().reverse().cwiseMax(0).cwiseSqrt();
  spread.weakest_direction_in_world = position.eigenvectors().col(2);
  // Chooses the sign that makes the largest coordinate positive, because both signs mean the same axis.
  Eigen::Index largest;
  spread.weakest_direction_in_world.cwiseAbs().maxCoeff(&largest);
  if (spread.weakest_direction_in_world[largest] < 0) spread.weakest_direction_in_world *= -1;
  return spread;
}

void PoseDistribution::Update(const Vector& errors, const Matrix& jacobian) {
  const Matrix of_errors = jacobian * of_images * jacobian.transpose() + Matrix::Identity();
  const Matrix gain = of_errors.ldlt().solve(jacobian * of_images).transpose();
  const Vector step = -gain * errors;
  const Matrix kept = Matrix::Identity() - gain * jacobian;
  const Eigen::Quaterniond rotation = (ExpSO3(step.head<3>()) * cam_from_world.rotation).normalized();
  cam_from_world = CamFromWorld(rotation, CamInWorld(cam_from_world) - rotation.conjugate() * step.tail<3>());
  of_images = Symmetric(kept * of_images * kept.transpose() + gain * gain.transpose());
  by_log_focal = kept * by_log_focal;
}

}  // namespace lazyloc

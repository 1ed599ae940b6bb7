#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

// A pose and its uncertainty. Covariances and derivatives are of the pose's tangent (w, R <- exp(w) R, then
// translation) in coordinates around the projection centre, where the translation is zero: rotation and position are
// apart there, and positions lose no digits to large coordinates.
struct PoseDistribution {
  using Matrix = Eigen::Matrix<double, 6, 6>;
  using Vector = Eigen::Matrix<double, 6, 1>;

  // Returns the whole covariance around the camera.
  Matrix Covariance() const;
  // Returns the covariance in coordinates in which the pose has this translation.
  Matrix CovarianceAt(const Eigen::Vector3d& translation) const;
  Eigen::Matrix3d RotationCovariance() const { return Covariance().topLeftCorner<3, 3>(); }
  // Returns the covariance of the projection centre in the world.
  Eigen::Matrix3d PositionCovariance() const;
  // Returns the covariance of world_from_cam: first of the projection centre, then of the rotation about the fixed axes
  // of the world (world_from_cam <- exp(turn) world_from_cam, in rad). ROS has it so.
  Matrix CovarianceInWorld() const;
  PoseSpread Spread() const;

  // Replaces the pose by the most probable one under measurements (the update of a Kalman filter). They are not weighed
  // against the error of the focal length, which follows. errors: in standard deviations; zero rows have no weight.
  // jacobian: their derivatives around the camera.
  void Update(const Vector& errors, const Matrix& jacobian);

  Rigid3d cam_from_world;
  Matrix of_images = Matrix::Zero();     // covariance by all causes but the focal length
  Vector by_log_focal = Vector::Zero();  // derivative by the log of the focal length
  double log_focal_variance = 0;         // expected square of the error of that
};

// Returns the derivative of the tangent around the camera by that in the coordinates of cam_from_world.
PoseDistribution::Matrix AroundCamera(const Rigid3d& cam_from_world);

// Return the distribution by a covariance in the coordinates of cam_from_world, and by independent errors of the
// rotation and of the projection centre in the world.
PoseDistribution MakePoseDistribution(const Rigid3d& cam_from_world, const PoseDistribution::Matrix& covariance);
PoseDistribution MakePoseDistribution(const Rigid3d& cam_from_world, const Eigen::Matrix3d& rotation_covariance,
                                      const Eigen::Matrix3d& position_covariance);

}  // namespace lazyloc

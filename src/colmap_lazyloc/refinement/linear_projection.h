#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

// The reprojection error of an observation as a function of the point in some frame: r = (A X + a) / (b . X + c).
struct LinearProjection {
  Eigen::Matrix<double, 2, 3> A;
  Eigen::Vector2d a;
  Eigen::Vector3d b;
  double c;

  // With the error in another unit.
  LinearProjection Scaled(double factor) const { return {factor * A, factor * a, b, c}; }

  // With what does not depend on the point multiplied: of a camera that stands farther from the frame's origin.
  LinearProjection WithOffset(double factor) const { return {A, factor * a, b, factor * c}; }

  double Depth(const Eigen::Vector3d& point) const { return b.dot(point) + c; }

  // Error in pixels, and its derivative with respect to the point.
  Eigen::Vector2d Error(const Eigen::Vector3d& point, Eigen::Matrix<double, 2, 3>* jacobian) const {
    const double inverse_depth = 1 / Depth(point);
    const Eigen::Vector2d error = inverse_depth * (A * point + a);
    *jacobian = inverse_depth * (A - error * b.transpose());
    return error;
  }

  // Of the error by the log of the factor of WithOffset, at 1.
  Eigen::Vector2d DerivativeByLogOffset(const Eigen::Vector3d& point, const Eigen::Vector2d& error) const {
    return (a - c * error) / Depth(point);
  }
};

// Of the point in the observing camera's frame.
inline LinearProjection ProjectionInCam(const Observation& observation) {
  return {observation.px_from_cam, Eigen::Vector2d::Zero(), observation.ray_in_cam, 0};
}

// Of the point in the world.
inline LinearProjection ProjectionInWorld(const Observation& observation, const Rigid3d& cam_from_world) {
  const Eigen::Matrix3d rotation = cam_from_world.rotation.toRotationMatrix();
  return {observation.px_from_cam * rotation, observation.px_from_cam * cam_from_world.translation,
          rotation.transpose() * observation.ray_in_cam, observation.ray_in_cam.dot(cam_from_world.translation)};
}

}  // namespace lazyloc

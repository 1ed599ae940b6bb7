#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

// Reprojection error of an observation as a function of the point X in some axes: r = (A X + a) / (b . X + c).
struct LinearProjection {
  Eigen::Matrix<double, 2, 3> A;
  Eigen::Vector2d a;
  Eigen::Vector3d b;
  double c;

  // Returns the projection with its error in another unit.
  LinearProjection Scaled(double factor) const { return {factor * A, factor * a, b, c}; }

  // Returns the projection of a camera whose offset from the origin of the axes is multiplied.
  LinearProjection WithOffset(double factor) const { return {A, factor * a, b, factor * c}; }

  double Depth(const Eigen::Vector3d& point) const { return b.dot(point) + c; }

  // Returns the error in pixels, and its derivative with respect to the point.
  Eigen::Vector2d Error(const Eigen::Vector3d& point, Eigen::Matrix<double, 2, 3>* jacobian) const {
    const double inverse_depth = 1 / Depth(point);
    const Eigen::Vector2d error = inverse_depth * (A * point + a);
    *jacobian = inverse_depth * (A - error * b.transpose());
    return error;
  }

  // Returns the derivative of the error with respect to the log of the factor of WithOffset, at factor 1.
  Eigen::Vector2d DerivativeByLogOffset(const Eigen::Vector3d& point, const Eigen::Vector2d& error) const {
    return (a - c * error) / Depth(point);
  }
};

// Returns the projection of points in the axes of the observing camera.
inline LinearProjection ProjectionInCam(const Observation& observation) {
  return {observation.px_from_cam, Eigen::Vector2d::Zero(), observation.ray_in_cam, 0};
}

// Returns the projection of points in the axes from which cam_from_world leads to the camera.
inline LinearProjection ProjectionInWorld(const Observation& observation, const Rigid3d& cam_from_world) {
  const Eigen::Matrix3d rotation = cam_from_world.rotation.toRotationMatrix();
  return {observation.px_from_cam * rotation, observation.px_from_cam * cam_from_world.translation,
          rotation.transpose() * observation.ray_in_cam, observation.ray_in_cam.dot(cam_from_world.translation)};
}

}  // namespace lazyloc

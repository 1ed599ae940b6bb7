#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"

namespace lazyloc {

// A keypoint as a viewing ray with its pixel derivative, computed once because the solvers know no camera model. The
// reprojection error of a point X in the camera's frame is, in pixels and to first order in the error,
//   r = px_from_cam X / (ray . X),
// i.e. X's displacement from the ray in the plane perpendicular to it, scaled to pixels by the model's derivative
// there. X lies in front of the camera where ray . X > 0.
struct Observation {
  Eigen::Vector3d ray_in_cam = Eigen::Vector3d::Zero();  // unit length
  // Annihilates the ray, unless this is not the keypoint's but that of an adjusted point (QueryCamera::Adjust).
  Eigen::Matrix<double, 2, 3> px_from_cam = Eigen::Matrix<double, 2, 3>::Zero();
  // The keypoint relative to the principal point. Every camera model projects a ray to its principal point plus focal
  // length times a function of the ray, so that this is the derivative of a fixed ray's keypoint with respect to the
  // log of the focal length.
  Eigen::Vector2d px_from_log_focal = Eigen::Vector2d::Zero();
};

// Returns the error in pixels; only meaningful in front of the camera.
inline Eigen::Vector2d ReprojectionError(const Observation& observation, const Eigen::Vector3d& point_in_cam) {
  return observation.px_from_cam * point_in_cam / observation.ray_in_cam.dot(point_in_cam);
}

inline bool IsInFront(const Observation& observation, const Eigen::Vector3d& point_in_cam) {
  return observation.ray_in_cam.dot(point_in_cam) > 0;
}

// Returns the angle in rad by which an error of one pixel turns the ray.
inline double RadFromPx(const Observation& observation) { return 1.41421356 / observation.px_from_cam.norm(); }

}  // namespace lazyloc

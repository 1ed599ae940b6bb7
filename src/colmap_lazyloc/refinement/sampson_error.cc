#include "colmap_lazyloc/refinement/sampson_error.h"

#include <cmath>

#include <Eigen/LU>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

// The inverse of px_from_cam on the ray's tangent plane.
Eigen::Matrix<double, 3, 2> RayFromPx(const Observation& observation) {
  const Eigen::Matrix<double, 2, 3>& px_from_cam = observation.px_from_cam;
  return px_from_cam.transpose() * (px_from_cam * px_from_cam.transpose()).inverse();
}

}  // namespace

EpipolarMatch MakeEpipolarMatch(const View& fixed_view, const Observation& fixed_observation, const View& free_view,
                                const Observation& free_observation, double noise_ratio) {
  const Eigen::Matrix3d world_from_fixed = fixed_view.cam_from_world.rotation.conjugate().toRotationMatrix();
  return {CamInWorld(fixed_view.cam_from_world), world_from_fixed * fixed_observation.ray_in_cam,
          free_observation.ray_in_cam,
          noise_ratio * fixed_view.noise_px * world_from_fixed * RayFromPx(fixed_observation),
          noise_ratio * free_view.noise_px * RayFromPx(free_observation)};
}

double SampsonError(const EpipolarMatch& match, const Eigen::Matrix3d& cam_from_world_rotation,
                    const Eigen::Vector3d& cam_in_world, Eigen::Matrix<double, 1, 6>* jacobian) {
  const Eigen::Matrix3d world_from_cam = cam_from_world_rotation.transpose();
  const Eigen::Vector3d baseline = cam_in_world - match.fixed_in_world;
  const Eigen::Vector3d& fixed_ray = match.fixed_ray_in_world;
  const Eigen::Vector3d free_ray = world_from_cam * match.free_ray_in_cam;
  const Eigen::Vector3d fixed_normal = free_ray.cross(baseline);                            // dg / d fixed_ray
  const Eigen::Vector3d free_normal = cam_from_world_rotation * baseline.cross(fixed_ray);  // dg / d free_ray_in_cam
  const Eigen::Vector2d fixed_slope = match.fixed_ray_noise_in_world.transpose() * fixed_normal;
  const Eigen::Vector2d free_slope = match.free_ray_noise_in_cam.transpose() * free_normal;
  const double stddev = std::sqrt(fixed_slope.squaredNorm() + free_slope.squaredNorm());
  jacobian->setZero();
  if (stddev == 0) return 0;
  const double error = fixed_normal.dot(fixed_ray) / stddev;

  // free_ray moves by world_from_cam Hat(free_ray_in_cam) w.
  const Eigen::Matrix3d ray_by_w = world_from_cam * Hat(match.free_ray_in_cam);
  Eigen::Matrix<double, 1, 6> gap, variance;  // of g, and half of that of stddev^2
  gap << free_normal.transpose() * Hat(match.free_ray_in_cam), fixed_ray.cross(free_ray).transpose();
  const Eigen::Matrix<double, 1, 3> by_fixed_normal = (match.fixed_ray_noise_in_world * fixed_slope).transpose();
  const Eigen::Matrix<double, 1, 3> by_free_normal = (match.free_ray_noise_in_cam * free_slope).transpose();
  variance << -by_fixed_normal * Hat(baseline) * ray_by_w - by_free_normal * Hat(free_normal),
      by_fixed_normal * Hat(free_ray) - by_free_normal * cam_from_world_rotation * Hat(fixed_ray);
  *jacobian = (gap - error / stddev * variance) / stddev;
  return error;
}

}  // namespace lazyloc

#include "colmap_lazyloc/ablation/sampson_error.h"

#include <cmath>

#include <Eigen/LU>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

// Returns the inverse of px_from_cam on the ray's tangent plane.
Eigen::Matrix<double, 3, 2> RayFromPx(const Observation& observation) {
  const Eigen::Matrix<double, 2, 3>& px_from_cam = observation.px_from_cam;
  return px_from_cam.transpose() * (px_from_cam * px_from_cam.transpose()).inverse();
}

}  // namespace

EpipolarMatch MakeEpipolarMatch(const Rigid3d& database_from_world, const NoisyObservation& database,
                                const NoisyObservation& query) {
  const Eigen::Matrix3d world_from_database = database_from_world.rotation.conjugate().toRotationMatrix();
  return {CamInWorld(database_from_world), world_from_database * database.observation.ray_in_cam,
          query.observation.ray_in_cam, database.noise_px * world_from_database * RayFromPx(database.observation),
          query.noise_px * RayFromPx(query.observation)};
}

double SampsonError(const EpipolarMatch& match, const Eigen::Matrix3d& cam_from_world_rotation,
                    const Eigen::Vector3d& cam_in_world, Eigen::Matrix<double, 1, 6>* jacobian) {
  const Eigen::Matrix3d world_from_cam = cam_from_world_rotation.transpose();
  const Eigen::Vector3d baseline = cam_in_world - match.database_in_world;
  const Eigen::Vector3d& database_ray = match.database_ray_in_world;
  const Eigen::Vector3d query_ray = world_from_cam * match.query_ray_in_cam;
  const Eigen::Vector3d database_normal = query_ray.cross(baseline);  // dg / d database_ray
  const Eigen::Vector3d query_normal =
      cam_from_world_rotation * baseline.cross(database_ray);  // dg / d query_ray_in_cam
  const Eigen::Vector2d database_slope = match.database_ray_noise_in_world.transpose() * database_normal;
  const Eigen::Vector2d query_slope = match.query_ray_noise_in_cam.transpose() * query_normal;
  const double stddev = std::sqrt(database_slope.squaredNorm() + query_slope.squaredNorm());
  jacobian->setZero();
  if (stddev == 0) return 0;
  const double error = database_normal.dot(database_ray) / stddev;

  // query_ray moves by world_from_cam Hat(query_ray_in_cam) w.
  const Eigen::Matrix3d ray_by_w = world_from_cam * Hat(match.query_ray_in_cam);
  Eigen::Matrix<double, 1, 6> gap, variance;  // of g, and half of that of stddev^2
  gap << query_normal.transpose() * Hat(match.query_ray_in_cam), database_ray.cross(query_ray).transpose();
  const Eigen::Matrix<double, 1, 3> by_database_normal =
      (match.database_ray_noise_in_world * database_slope).transpose();
  const Eigen::Matrix<double, 1, 3> by_query_normal = (match.query_ray_noise_in_cam * query_slope).transpose();
  variance << -by_database_normal * Hat(baseline) * ray_by_w - by_query_normal * Hat(query_normal),
      by_database_normal * Hat(query_ray) - by_query_normal * cam_from_world_rotation * Hat(database_ray);
  *jacobian = (gap - error / stddev * variance) / stddev;
  return error;
}

}  // namespace lazyloc

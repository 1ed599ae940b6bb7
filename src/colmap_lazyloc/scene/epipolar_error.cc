#include "colmap_lazyloc/scene/epipolar_error.h"

#include <algorithm>
#include <cmath>

namespace lazyloc {

EpipolarError MeasureEpipolarError(const Rigid3d& a_from_b, const Observation& a, const Observation& b) {
  const Eigen::Vector3d a_ray = a_from_b.rotation.conjugate() * a.ray_in_cam;
  const Eigen::Vector3d& b_ray = b.ray_in_cam;
  const Eigen::Vector3d direction = CamInWorld(a_from_b).normalized();
  const Eigen::Vector3d normal = b_ray.cross(a_ray);
  const double a_rad = RadFromPx(a), b_rad = RadFromPx(b);
  if (direction.cross(a_ray).dot(normal) <= 0 || direction.cross(b_ray).dot(normal) <= 0) {
    return {normal.squaredNorm() / (a_rad * a_rad + b_rad * b_rad), false};
  }
  const double variance = std::pow(a_rad, 2) * direction.cross(b_ray).squaredNorm() +
                          std::pow(b_rad, 2) * direction.cross(a_ray).squaredNorm();
  return {std::pow(normal.dot(direction), 2) / std::max(variance, 1e-24), true};
}

}  // namespace lazyloc

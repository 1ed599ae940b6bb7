#include "colmap_lazyloc/scene/equirectangular.h"

#include <cmath>

namespace lazyloc {

Eigen::Vector3d EquirectangularRay(const Camera& camera, const Eigen::Vector2d& xy) {
  const double longitude = 2 * M_PI * (xy.x() / camera.params[0] - 0.5);
  const double latitude = M_PI * (xy.y() / camera.params[1] - 0.5);  // downwards
  return {std::cos(latitude) * std::sin(longitude), std::sin(latitude), std::cos(latitude) * std::cos(longitude)};
}

Eigen::Vector2d EquirectangularPoint(const Camera& camera, const Eigen::Vector3d& direction_in_cam) {
  const double longitude = std::atan2(direction_in_cam.x(), direction_in_cam.z());
  const double latitude = std::atan2(direction_in_cam.y(), std::hypot(direction_in_cam.x(), direction_in_cam.z()));
  return {camera.params[0] * (longitude / (2 * M_PI) + 0.5), camera.params[1] * (latitude / M_PI + 0.5)};
}

double EquirectangularPxPerRad(const Camera& camera) { return camera.params[0] / (2 * M_PI); }

}  // namespace lazyloc

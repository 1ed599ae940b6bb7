#include "colmap_lazyloc/bridge/triangulation.h"

#include <Eigen/Geometry>
#include <colmap/geometry/triangulation.h>

namespace lazyloc {

std::optional<Eigen::Vector3d> TriangulatePoint(const std::vector<Eigen::Matrix<double, 3, 4>>& cams_from_world,
                                                const std::vector<Eigen::Vector3d>& rays_in_cam) {
  std::vector<Eigen::Vector2d> points(rays_in_cam.size());
  for (size_t i = 0; i < points.size(); ++i) points[i] = rays_in_cam[i].hnormalized();
  const Eigen::Vector3d point = colmap::TriangulateMultiViewPoint(cams_from_world, points);
  if (!point.allFinite()) return std::nullopt;
  return point;
}

}  // namespace lazyloc

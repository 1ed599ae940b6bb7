#include "colmap_lazyloc/bridge/triangulation.h"

#include <Eigen/Geometry>
#include <colmap/geometry/triangulation.h>

namespace lazyloc {

std::optional<Eigen::Vector3d> TriangulatePoint(const std::vector<Eigen::Matrix<double, 3, 4>>& cams_from_world,
                                                const std::vector<Eigen::Vector3d>& rays_in_cam) {
  // A ray behind the image plane becomes its opposite, which is on the same line: to the equations that is all the same.
  std::vector<Eigen::Vector2d> points(rays_in_cam.size());
  for (size_t i = 0; i < points.size(); ++i) points[i] = rays_in_cam[i].hnormalized();
  Eigen::Vector3d point;
  const bool is_solved = colmap::TriangulateMultiViewPoint({cams_from_world.data(), cams_from_world.size()},
                                                           {points.data(), points.size()}, &point);
  if (!is_solved || !point.allFinite()) return std::nullopt;
  return point;
}

}  // namespace lazyloc

#include "colmap_lazyloc/bridge/triangulation.h"

#include <colmap/geometry/triangulation.h>

namespace lazyloc {

std::optional<Eigen::Vector3d> TriangulatePoint(const std::vector<Eigen::Matrix<double, 3, 4>>& cams_from_world,
                                                const std::vector<Eigen::Vector2d>& points_in_plane) {
  const Eigen::Vector3d point = colmap::TriangulateMultiViewPoint(cams_from_world, points_in_plane);
  if (!point.allFinite()) return std::nullopt;
  return point;
}

}  // namespace lazyloc

#include "colmap_lazyloc/bridge/triangulation.h"

#include <colmap/geometry/triangulation.h>

namespace lazyloc {

std::optional<Eigen::Vector3d> TriangulatePoint(const std::vector<Eigen::Matrix<double, 3, 4>>& cams_from_world,
                                                const std::vector<Eigen::Vector2d>& points_in_plane) {
  Eigen::Vector3d point;
  const bool is_solved = colmap::TriangulateMultiViewPoint({cams_from_world.data(), cams_from_world.size()},
                                                           {points_in_plane.data(), points_in_plane.size()}, &point);
  if (!is_solved || !point.allFinite()) return std::nullopt;
  return point;
}

}  // namespace lazyloc

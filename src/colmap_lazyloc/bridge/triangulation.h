#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

namespace lazyloc {

// COLMAP's linear multi-view triangulation: the point nearest to all viewing rays in the algebraic sense.
// cams_from_world: [R | t]; rays_in_cam: any length, one per camera. None where the rays meet at infinity.
std::optional<Eigen::Vector3d> TriangulatePoint(const std::vector<Eigen::Matrix<double, 3, 4>>& cams_from_world,
                                                const std::vector<Eigen::Vector3d>& rays_in_cam);

}  // namespace lazyloc

#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

namespace lazyloc {

// COLMAP's linear multi-view triangulation: the point nearest to all viewing rays in the algebraic sense.
// cams_from_world: [R | t]; points_in_plane: where the viewing rays meet the planes z = 1 of the cameras' frames, one
// per camera. (A ray behind its camera becomes its opposite, which to the equations is the same.) None where the rays
// meet at infinity.
std::optional<Eigen::Vector3d> TriangulatePoint(const std::vector<Eigen::Matrix<double, 3, 4>>& cams_from_world,
                                                const std::vector<Eigen::Vector2d>& points_in_plane);

}  // namespace lazyloc

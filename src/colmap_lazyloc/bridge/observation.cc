#include "colmap_lazyloc/bridge/observation.h"

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
Observer::Observer(const Camera& camera) : ray_in_cam_(RaysInCam(camera)), principal_point_(PrincipalPoint(camera)) {}

std::optional<Observation> Observer::operator()(const Eigen::Vector2d& xy) const {
  // Takes central differences, whose second-order terms cancel, of half a pixel, which is far above the tolerance of
  // the iterative inverse.
  constexpr double kStepPx = 0.5;
  const std::optional<Eigen::Vector3d> ray = ray_in_cam_(xy);
  if (!ray) return std::nullopt;
  const Eigen::Matrix<double, 3, 2> basis = TangentBasis(*ray);
  Eigen::Matrix2d tangent_from_px;
  for (int axis = 0; axis < 2; ++axis) {
    const Eigen::Vector2d step = kStepPx * Eigen::Vector2d::Unit(axis);
    const std::optional<Eigen::Vector3d> before = ray_in_cam_(xy - step), after = ray_in_cam_(xy + step);
    if (!before || !after) return std::nullopt;
    tangent_from_px.col(axis) = basis.transpose() * (*after - *before) / (2 * kStepPx);
  }
  const Eigen::Matrix2d px_from_tangent = tangent_from_px.inverse();
  if (!px_from_tangent.allFinite()) return std::nullopt;
  return Observation{*ray, px_from_tangent * basis.transpose(), xy - principal_point_};
}

}  // namespace lazyloc

#include "colmap_lazyloc/bridge/observer.h"

#include <Eigen/LU>

namespace lazyloc {

Observer::Observer(const Camera& camera) : ray_in_cam_(RaysInCam(camera)), principal_point_(PrincipalPoint(camera)) {}

std::optional<Observation> Observer::operator()(const Eigen::Vector2d& xy) const {
  // Takes differences of a tenth of a pixel: far above the tolerance of the iterative inverse, and so short that the
  // derivative hardly changes.
  constexpr double kStepPx = 0.1;
  const std::optional<Eigen::Vector3d> ray = ray_in_cam_(xy);
  if (!ray) return std::nullopt;
  Eigen::Matrix<double, 3, 2> ray_from_px;
  for (int axis = 0; axis < 2; ++axis) {
    const std::optional<Eigen::Vector3d> after = ray_in_cam_(xy + kStepPx * Eigen::Vector2d::Unit(axis));
    if (!after) return std::nullopt;
    // Removes the part along the ray, which is due to the length of the step.
    ray_from_px.col(axis) = (*after - ray->dot(*after) * *ray) / kStepPx;
  }
  const Eigen::Matrix<double, 2, 3> px_from_cam =
      (ray_from_px.transpose() * ray_from_px).inverse() * ray_from_px.transpose();
  if (!px_from_cam.allFinite()) return std::nullopt;
  return Observation{*ray, px_from_cam, xy - principal_point_};
}

}  // namespace lazyloc

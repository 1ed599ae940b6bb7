#include "colmap_lazyloc/bridge/observation.h"

#include <cmath>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

// Step of the log focal length in numeric differentiation: moves image points about as far as kStepPx below.
constexpr double kFocalStep = 1e-3;

}  // namespace

Observer::Observer(const Camera& camera, bool seeks_focal_length) : ray_in_cam_(RaysInCam(camera)) {
  if (!seeks_focal_length) return;
  ray_in_shorter_cam_ = RaysInCam(WithFocalFactor(camera, std::exp(-kFocalStep)));
  ray_in_longer_cam_ = RaysInCam(WithFocalFactor(camera, std::exp(kFocalStep)));
}

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
  Observation observation{*ray, px_from_tangent * basis.transpose()};
  if (ray_in_longer_cam_) {
    const std::optional<Eigen::Vector3d> before = ray_in_shorter_cam_(xy), after = ray_in_longer_cam_(xy);
    if (!before || !after) return std::nullopt;
    // Negates the derivative: the differences fix the image point and turn its ray, whereas a fixed ray's image point
    // moves by as much in the opposite direction.
    observation.px_from_log_focal = -observation.px_from_cam * (*after - *before) / (2 * kFocalStep);
  }
  return observation;
}

}  // namespace lazyloc

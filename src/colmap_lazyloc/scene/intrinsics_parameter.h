#pragma once

#include <cmath>

#include <Eigen/Core>

namespace lazyloc {

// Corrections of a camera's intrinsics.
enum IntrinsicsParameter {
  LOG_FOCAL_FACTOR,
  PRINCIPAL_POINT_X,  // px
  PRINCIPAL_POINT_Y,
  LOG_ASPECT_RATIO,   // of the focal lengths in y and x, whose product stays
  RADIAL_DISTORTION,  // displacement in px of an image point kRadialUnitPx from the principal point; grows as the cube
  FIFTH_POWER_DISTORTION,  // the same, but it grows as the fifth power
  NUM_INTRINSICS_PARAMETERS,
};
inline constexpr double kRadialUnitPx = 1000;

using IntrinsicsCorrections = Eigen::Matrix<double, NUM_INTRINSICS_PARAMETERS, 1>;
using IntrinsicsCovariance = Eigen::Matrix<double, NUM_INTRINSICS_PARAMETERS, NUM_INTRINSICS_PARAMETERS>;

// Returns the derivative of a point's projection in pixels with respect to the corrections. offset: of the projection
// from the principal point.
inline Eigen::Matrix<double, 2, NUM_INTRINSICS_PARAMETERS> CorrectionDerivative(const Eigen::Vector2d& offset) {
  Eigen::Matrix<double, 2, NUM_INTRINSICS_PARAMETERS> derivative;
  derivative.col(LOG_FOCAL_FACTOR) = offset;
  derivative.col(PRINCIPAL_POINT_X) = Eigen::Vector2d::UnitX();
  derivative.col(PRINCIPAL_POINT_Y) = Eigen::Vector2d::UnitY();
  derivative.col(LOG_ASPECT_RATIO) = Eigen::Vector2d(-0.5, 0.5).cwiseProduct(offset);
  derivative.col(RADIAL_DISTORTION) = offset * offset.squaredNorm() / std::pow(kRadialUnitPx, 3);
  derivative.col(FIFTH_POWER_DISTORTION) = offset * std::pow(offset.squaredNorm(), 2) / std::pow(kRadialUnitPx, 5);
  return derivative;
}

}  // namespace lazyloc

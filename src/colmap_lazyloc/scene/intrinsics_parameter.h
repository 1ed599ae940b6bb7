#pragma once

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

}  // namespace lazyloc

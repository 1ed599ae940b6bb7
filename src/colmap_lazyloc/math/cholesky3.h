#pragma once

#include <cmath>

#include <Eigen/Core>

namespace lazyloc {

// Returns L^-1 of a = L L^T, in closed form because bundle adjustment needs one per point and evaluation. Reads only
// the lower triangle of `a`. Some elements of the result are not finite if `a` is not positive definite.
inline Eigen::Matrix3d InverseCholeskyFactor(const Eigen::Matrix3d& a) {
  const double l00 = std::sqrt(a(0, 0)), l10 = a(1, 0) / l00, l20 = a(2, 0) / l00;
  const double l11 = std::sqrt(a(1, 1) - l10 * l10), l21 = (a(2, 1) - l20 * l10) / l11;
  const double l22 = std::sqrt(a(2, 2) - l20 * l20 - l21 * l21);
  const double i10 = -l10 / (l00 * l11), i21 = -l21 / (l11 * l22);
  Eigen::Matrix3d inverse;
  inverse << 1 / l00, 0, 0, i10, 1 / l11, 0, -(l20 / l00 + l21 * i10) / l22, i21, 1 / l22;
  return inverse;
}

}  // namespace lazyloc

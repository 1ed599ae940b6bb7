#pragma once

#include <algorithm>

namespace lazyloc {

// Weights of iteratively reweighted least squares, for a residual of given squared norm and a scale in its unit.
// All are 1 at zero but L1's, which is 1 / |r|.

// |r|: Weiszfeld's weight; the floor keeps it finite where a residual vanishes.
inline double L1Weight(double norm, double floor) { return 1 / std::max(norm, floor); }

// rho = scale^2 / 2 * r^2 / (scale^2 + r^2): gross outliers lose all influence.
inline double GemanMcClureWeight(double squared_norm, double scale) {
  const double quotient = 1 / (1 + squared_norm / (scale * scale));
  return quotient * quotient;
}

// rho = scale^2 / 2 * log(1 + r^2 / scale^2).
inline double CauchyWeight(double squared_norm, double scale) { return 1 / (1 + squared_norm / (scale * scale)); }

}  // namespace lazyloc

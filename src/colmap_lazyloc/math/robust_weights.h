#pragma once

#include <algorithm>

namespace lazyloc {

// Weights rho'(r) / r of iteratively reweighted least squares for robust losses rho. scale: in the unit of the residual
// r. Each weight except L1's is 1 at r = 0.

// Returns Weiszfeld's weight 1 / |r| of the loss |r|. The floor keeps it finite if the residual vanishes.
inline double L1Weight(double norm, double floor) { return 1 / std::max(norm, floor); }

// Returns the weight of rho = scale^2 / 2 * r^2 / (scale^2 + r^2). Gross outliers lose their influence, because the
// weight falls as 1 / r^4.
inline double GemanMcClureWeight(double squared_norm, double scale) {
  const double quotient = 1 / (1 + squared_norm / (scale * scale));
  return quotient * quotient;
}

}  // namespace lazyloc

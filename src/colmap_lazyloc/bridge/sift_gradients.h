#pragma once

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "colmap_lazyloc/bridge/sift_level.h"
#include "colmap_lazyloc/math/vectorized.h"

// Gradients of a few pixels at a time, for the orientation and the descriptor of a keypoint. No gradient is stored,
// because keypoints need those around them only. All functions compute what VLFeat's inline functions do, in a form
// that the compiler vectorises.

namespace lazyloc {

constexpr int kStripSize = 64;  // a multiple of what fits into a vector

// Gradients of pixels in a row.
struct GradientStrip {
  std::array<float, kStripSize> magnitude, angle;  // angle: in [0, 2 pi]
};

// Returns the number of values that loops compute for `size`: whole vectors. Those from `size` on are not used.
LAZYLOC_ALWAYS_INLINE inline int PaddedSize(int size) {
  static_assert(kStripSize % kLevelPadding == 0);
  return (size + kLevelPadding - 1) / kLevelPadding * kLevelPadding;
}

// Takes two steps of Newton's method for the reciprocal square root, which begins with half of the negative exponent.
LAZYLOC_ALWAYS_INLINE inline float SquareRoot(float x) {
  int32_t bits;
  std::memcpy(&bits, &x, sizeof(bits));
  bits = 0x5f3759df - (bits >> 1);
  float reciprocal;
  std::memcpy(&reciprocal, &bits, sizeof(reciprocal));
  const float half = 0.5f * x;
  reciprocal = reciprocal * (1.5f - half * reciprocal * reciprocal);
  reciprocal = reciprocal * (1.5f - half * reciprocal * reciprocal);
  return x <= 1e-8f ? 0 : x * reciprocal;
}

// Approximates the arc tangent by a polynomial in each half of the plane.
LAZYLOC_ALWAYS_INLINE inline float Angle(float x, float y) {
  const float abs_x = std::abs(x), abs_y = std::abs(y) + FLT_EPSILON;
  const float difference = x >= 0 ? abs_x - abs_y : abs_y - abs_x;
  const float ratio = difference / (abs_x + abs_y);
  const float middle = static_cast<float>(x >= 0 ? M_PI / 4 : 3 * M_PI / 4);
  const float angle = middle + (0.1821f * ratio * ratio - 0.9675f) * ratio;
  const auto turned = static_cast<float>((y < 0 ? -angle : angle) + 2 * M_PI);
  constexpr auto kTurn = static_cast<float>(2 * M_PI);
  return turned > kTurn ? turned - kTurn : turned;
}

// Computes the gradients of `size` pixels of row y from x on; at the border, as the difference to the one neighbour.
LAZYLOC_ALWAYS_INLINE inline void ComputeGradients(const SiftLevel& level, int x, int y, int size,
                                                   GradientStrip* strip) {
  const float* row = level.Row(y);
  const float* above = level.Row(std::max(y - 1, 0));
  const float* below = level.Row(std::min(y + 1, level.height - 1));
  const float step_y = y > 0 && y < level.height - 1 ? 0.5f : 1;
  const auto compute = [&](int i, int left, int right, float step_x) LAZYLOC_ALWAYS_INLINE {
    const float gradient_x = step_x * (row[right] - row[left]);
    const float gradient_y = step_y * (below[x + i] - above[x + i]);
    strip->magnitude[i] = SquareRoot(gradient_x * gradient_x + gradient_y * gradient_y);
    strip->angle[i] = Angle(gradient_x, gradient_y);
  };
  const int first = x == 0 ? 1 : 0;
  const int padded = PaddedSize(size);
  for (int i = first; i < padded; ++i) compute(i, x + i - 1, x + i + 1, 0.5f);
  if (x == 0) compute(0, 0, std::min(1, level.width - 1), 1);
  if (x + size == level.width) compute(size - 1, std::max(level.width - 2, 0), level.width - 1, 1);
}

// Returns exp(-x), interpolated in a table like VLFeat's.
class ExponentialTable {
 public:
  static constexpr double kMax = 25;  // more than any x here
  static constexpr int kSize = 256;

  ExponentialTable() {
    for (size_t k = 0; k < values_.size(); ++k) values_[k] = std::exp(-static_cast<double>(k) * (kMax / kSize));
  }

  LAZYLOC_ALWAYS_INLINE double operator()(double x) const {
    x *= kSize / kMax;
    const auto k = static_cast<size_t>(x);
    return values_[k] + (x - static_cast<double>(k)) * (values_[k + 1] - values_[k]);
  }

 private:
  std::array<double, kSize + 1> values_;
};

inline const ExponentialTable kExponential;

}  // namespace lazyloc

#include "colmap_lazyloc/bridge/sift_gradients.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "colmap_lazyloc/math/vectorized.h"

namespace lazyloc {
namespace {

// The next two functions compute what VLFeat's inline functions do, in a form that the compiler vectorises.

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

LAZYLOC_ALWAYS_INLINE inline void SetGradient(float x, float y, float* gradient) {
  gradient[0] = SquareRoot(x * x + y * y);
  gradient[1] = Angle(x, y);
}

// above, below: the rows before and after `row`; at the border, `row` itself. step_y: 1 over their distance.
LAZYLOC_ALWAYS_INLINE inline void ComputeRow(const float* __restrict row, const float* __restrict above,
                                             const float* __restrict below, float step_y, int width,
                                             float* __restrict gradients) {
  const auto compute = [&](int x, int left, int right, float step_x) LAZYLOC_ALWAYS_INLINE {
    SetGradient(step_x * (row[right] - row[left]), step_y * (below[x] - above[x]), gradients + 2 * x);
  };
  compute(0, 0, std::min(1, width - 1), 1);
  for (int x = 1; x < width - 1; ++x) compute(x, x - 1, x + 1, 0.5f);
  compute(width - 1, std::max(width - 2, 0), width - 1, 1);
}

}  // namespace

void ComputeGradients(const float* image, int width, int height, IdleThreads* idle_threads, float* gradients) {
  ParallelForRanges(
      static_cast<size_t>(height),
      [&](size_t begin, size_t end) {
        RunVectorized([&]() LAZYLOC_ALWAYS_INLINE {
          for (int y = static_cast<int>(begin); y < static_cast<int>(end); ++y) {
            const auto row = [&](int v) { return image + static_cast<size_t>(std::clamp(v, 0, height - 1)) * width; };
            const float step_y = y > 0 && y < height - 1 ? 0.5f : 1;
            ComputeRow(row(y), row(y - 1), row(y + 1), step_y, width, gradients + 2 * static_cast<size_t>(y) * width);
          }
        });
      },
      idle_threads);
}

}  // namespace lazyloc

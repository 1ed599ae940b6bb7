#include "colmap_lazyloc/bridge/sift_descriptor.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "colmap_lazyloc/bridge/vlfeat.h"
#include "colmap_lazyloc/math/vectorized.h"

namespace lazyloc {
namespace {

constexpr double kBinSizePerScale = 3;
constexpr double kWindowStddev = 2;  // of the Gaussian window, in bins
constexpr int kStripSize = 32;       // pixels that are computed together
constexpr float kLimit = 0.2f;

// Bins with a margin of one on each side, so that no gradient within reach misses its bins.
constexpr int kNumPaddedBins = kNumSpatialBins + 2;
using PaddedHistogram = std::array<float, kNumPaddedBins * kNumPaddedBins * kNumAngularBins>;

// Returns exp(-x), interpolated in a table like VLFeat's.
class ExponentialTable {
 public:
  ExponentialTable() {
    for (size_t k = 0; k < values_.size(); ++k) values_[k] = std::exp(-static_cast<double>(k) * (kMax / kSize));
  }

  double operator()(double x) const {
    x *= kSize / kMax;
    const auto k = static_cast<size_t>(x);
    return values_[k] + (x - static_cast<double>(k)) * (values_[k + 1] - values_[k]);
  }

 private:
  static constexpr double kMax = 25;  // more than any x in a descriptor
  static constexpr int kSize = 256;
  std::array<double, kSize + 1> values_;
};

struct Frame {
  double cosine, sine, bin_size;
};

// Place of pixels in bins, from the centre of the descriptor and from its orientation.
struct Strip {
  std::array<float, kStripSize> x, y, angle, magnitude;
};

LAZYLOC_ALWAYS_INLINE inline float Positive(float angle) {
  return angle < 0 ? angle + static_cast<float>(2 * M_PI) : angle;
}

// Computes the first `size` pixels of a strip. first_x, y: its first pixel, seen from the keypoint.
LAZYLOC_ALWAYS_INLINE inline void ComputeStrip(const float* gradients, const Frame& frame, double first_x, double y,
                                               double orientation, int size, Strip* strip) {
  const double dy = static_cast<float>(y);
  for (int i = 0; i < size; ++i) {
    const double dx = static_cast<float>(first_x + i);
    strip->x[i] = static_cast<float>((frame.cosine * dx + frame.sine * dy) / frame.bin_size);
    strip->y[i] = static_cast<float>((-frame.sine * dx + frame.cosine * dy) / frame.bin_size);
    const float angle = Positive(static_cast<float>(gradients[2 * i + 1] - orientation));
    strip->angle[i] = static_cast<float>(kNumAngularBins * angle / (2 * M_PI));
    strip->magnitude[i] = gradients[2 * i];
  }
}

// Returns the bin whose centre is at or before a place.
LAZYLOC_ALWAYS_INLINE inline int BinBefore(float place) {
  return static_cast<int>(std::floor(static_cast<float>(place - 0.5)));
}

// Adds a gradient to the eight bins around it, if it has any.
LAZYLOC_ALWAYS_INLINE inline void AddGradient(float x, float y, float angle, float magnitude,
                                              const ExponentialTable& exponential, PaddedHistogram* histogram) {
  constexpr int kCentre = kNumPaddedBins / 2;
  const int bin_x = BinBefore(x), bin_y = BinBefore(y), bin_angle = static_cast<int>(angle);
  if (bin_x < -kCentre || bin_x > kCentre - 2 || bin_y < -kCentre || bin_y > kCentre - 2) return;
  const auto window = static_cast<float>(exponential((x * x + y * y) / (2 * kWindowStddev * kWindowStddev)));
  const auto rest_x = static_cast<float>(x - (bin_x + 0.5)), rest_y = static_cast<float>(y - (bin_y + 0.5));
  const float rest_angle = angle - static_cast<float>(bin_angle);
  for (int i = 0; i < 2; ++i) {
    const float weight_x = window * magnitude * std::abs(static_cast<float>(1 - i) - rest_x);
    for (int j = 0; j < 2; ++j) {
      const float weight = weight_x * std::abs(static_cast<float>(1 - j) - rest_y);
      const int bin = (bin_y + j + kCentre) * kNumPaddedBins + bin_x + i + kCentre;
      float* angles = &(*histogram)[static_cast<size_t>(bin * kNumAngularBins)];
      angles[bin_angle % kNumAngularBins] += weight * std::abs(1 - rest_angle);
      angles[(bin_angle + 1) % kNumAngularBins] += weight * std::abs(0 - rest_angle);
    }
  }
}

LAZYLOC_ALWAYS_INLINE inline void FillHistogram(const GradientImage& gradients, const SiftKeypoint& keypoint,
                                                PaddedHistogram* histogram) {
  static const ExponentialTable exponential;
  const double bin_size = kBinSizePerScale * keypoint.scale + DBL_EPSILON;
  const Frame frame = {std::cos(keypoint.orientation_rad), std::sin(keypoint.orientation_rad), bin_size};
  const int radius = static_cast<int>(std::floor(std::sqrt(2.0) * bin_size * (kNumSpatialBins + 1) / 2 + 0.5));
  const int x = static_cast<int>(keypoint.x + 0.5), y = static_cast<int>(keypoint.y + 0.5);
  const int end_x = std::min(x + radius + 1, gradients.width - 1),
            end_y = std::min(y + radius + 1, gradients.height - 1);
  Strip strip;
  for (int v = std::max(y - radius, 1); v < end_y; ++v) {
    for (int u = std::max(x - radius, 1); u < end_x; u += kStripSize) {
      const int size = std::min(kStripSize, end_x - u);
      const float* values = gradients.values + 2 * (static_cast<size_t>(v) * gradients.width + u);
      ComputeStrip(values, frame, u - keypoint.x, v - keypoint.y, keypoint.orientation_rad, size, &strip);
      for (int i = 0; i < size; ++i) {
        AddGradient(strip.x[i], strip.y[i], strip.angle[i], strip.magnitude[i], exponential, histogram);
      }
    }
  }
}

void Normalize(SiftHistogram* histogram) {
  float norm = 0;
  for (const float value : *histogram) norm += value * value;
  norm = vl_fast_sqrt_f(norm) + FLT_EPSILON;
  for (float& value : *histogram) value /= norm;
}

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

SiftHistogram DescribeKeypoint(const GradientImage& gradients, const SiftKeypoint& keypoint) {
  PaddedHistogram padded = {};
  RunVectorized([&]() LAZYLOC_ALWAYS_INLINE { FillHistogram(gradients, keypoint, &padded); });
  SiftHistogram histogram;
  constexpr size_t kRowSize = kNumSpatialBins * kNumAngularBins;
  for (size_t row = 0; row < kNumSpatialBins; ++row) {
    const size_t first = ((row + 1) * kNumPaddedBins + 1) * kNumAngularBins;
    std::copy_n(&padded[first], kRowSize, &histogram[row * kRowSize]);
  }
  Normalize(&histogram);
  for (float& value : histogram) value = std::min(value, kLimit);
  Normalize(&histogram);
  return histogram;
}

}  // namespace lazyloc

#include "colmap_lazyloc/bridge/sift_descriptor.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <limits>

#include "colmap_lazyloc/bridge/sift_gradients.h"

namespace lazyloc {
namespace {

constexpr double kBinSizePerScale = 3;
constexpr double kWindowStddev = 2;                     // of the Gaussian window, in bins
constexpr double kReach = (kNumSpatialBins + 1) / 2.0;  // of the bins from the centre, in bins
// To multiply by it gives what VLFeat's division by its inverse does for all values in [0, 2 pi], rounded to float.
constexpr double kBinsPerRadian = kNumAngularBins / (2 * M_PI);
constexpr float kLimit = 0.2f;

// Bins with a margin of one on each side, so that no gradient within reach misses its bins.
constexpr int kNumPaddedBins = kNumSpatialBins + 2;
// The values of all angles at one place.
using Angles = float __attribute__((vector_size(kNumAngularBins * sizeof(float))));
using PaddedHistogram = std::array<Angles, kNumPaddedBins * kNumPaddedBins>;

struct Frame {
  double cosine, sine, bin_size, orientation;
};

// Place of pixels in bins, seen from the centre of the descriptor and from its orientation.
struct Strip {
  std::array<int, kStripSize> cell;        // the first of the 2 x 2 bins around; -1 if there are none
  std::array<float, kStripSize> distance;  // squared, in standard deviations of the window
  std::array<float, kStripSize> window;
  std::array<float, kStripSize> rest_x, rest_y;  // from the centre of the first bin
  std::array<int, kStripSize> bin_angle;         // the first of two
  std::array<float, kStripSize> rest_angle;
  std::array<std::array<float, kStripSize>, 4> weight;  // of the 2 x 2 bins
};

LAZYLOC_ALWAYS_INLINE inline float Positive(float angle) {
  return angle < 0 ? angle + static_cast<float>(2 * M_PI) : angle;
}

// Returns the bin whose centre is at or before a place.
LAZYLOC_ALWAYS_INLINE inline int BinBefore(float place) {
  const float shifted = place - 0.5f;
  const int truncated = static_cast<int>(shifted);
  return truncated - (shifted < static_cast<float>(truncated) ? 1 : 0);
}

// Finds the bins of the pixels. first_x, y: the first pixel, seen from the keypoint.
LAZYLOC_ALWAYS_INLINE inline void FindBins(const GradientStrip& gradients, const Frame& frame, double first_x, double y,
                                           int padded_size, Strip* strip) {
  constexpr int kCentre = kNumPaddedBins / 2;
  const double dy = static_cast<float>(y);
  for (int i = 0; i < padded_size; ++i) {
    const double dx = static_cast<float>(first_x + i);
    const auto bins_x = static_cast<float>((frame.cosine * dx + frame.sine * dy) / frame.bin_size);
    const auto bins_y = static_cast<float>((-frame.sine * dx + frame.cosine * dy) / frame.bin_size);
    const int bin_x = BinBefore(bins_x), bin_y = BinBefore(bins_y);
    const bool is_inside = (bin_x >= -kCentre) & (bin_x <= kCentre - 2) & (bin_y >= -kCentre) & (bin_y <= kCentre - 2);
    strip->cell[i] = is_inside ? (bin_y + kCentre) * kNumPaddedBins + bin_x + kCentre : -1;
    strip->rest_x[i] = bins_x - (static_cast<float>(bin_x) + 0.5f);
    strip->rest_y[i] = bins_y - (static_cast<float>(bin_y) + 0.5f);
    strip->distance[i] = (bins_x * bins_x + bins_y * bins_y) / static_cast<float>(2 * kWindowStddev * kWindowStddev);
  }
  for (int i = 0; i < padded_size; ++i) {
    const float angle = Positive(static_cast<float>(gradients.angle[i] - frame.orientation));
    const auto bins = static_cast<float>(angle * kBinsPerRadian);
    strip->bin_angle[i] = static_cast<int>(bins);
    strip->rest_angle[i] = bins - static_cast<float>(strip->bin_angle[i]);
  }
}

// Computes the weights of the bins that have been found.
LAZYLOC_ALWAYS_INLINE inline void ComputeWeights(const GradientStrip& gradients, int size, Strip* strip) {
  for (int i = 0; i < size; ++i) {
    strip->window[i] = strip->cell[i] < 0 ? 0 : static_cast<float>(kExponential(strip->distance[i]));
  }
  const int padded = PaddedSize(size);
  for (int i = 0; i < padded; ++i) {
    const float value = strip->window[i] * gradients.magnitude[i];
    const float left = value * std::abs(1 - strip->rest_x[i]), right = value * std::abs(0 - strip->rest_x[i]);
    const float upper = std::abs(1 - strip->rest_y[i]), lower = std::abs(0 - strip->rest_y[i]);
    strip->weight[0][i] = left * upper;
    strip->weight[1][i] = right * upper;
    strip->weight[2][i] = left * lower;
    strip->weight[3][i] = right * lower;
  }
}

// Adds the pixels to their bins, in their order. A bin that a pixel does not have gets 0, which changes no bit.
LAZYLOC_ALWAYS_INLINE inline void AddToBins(const Strip& strip, int size, PaddedHistogram* histogram) {
  static constexpr std::array<Angles, kNumAngularBins + 2> kUnit = {Angles{1},
                                                                    Angles{0, 1},
                                                                    Angles{0, 0, 1},
                                                                    Angles{0, 0, 0, 1},
                                                                    Angles{0, 0, 0, 0, 1},
                                                                    Angles{0, 0, 0, 0, 0, 1},
                                                                    Angles{0, 0, 0, 0, 0, 0, 1},
                                                                    Angles{0, 0, 0, 0, 0, 0, 0, 1},
                                                                    Angles{1},
                                                                    Angles{0, 1}};
  for (int i = 0; i < size;) {
    const int cell = strip.cell[i];
    if (cell < 0) {
      ++i;
      continue;
    }
    Angles* upper = &(*histogram)[cell];
    Angles* lower = upper + kNumPaddedBins;
    Angles sums[4] = {upper[0], upper[1], lower[0], lower[1]};
    do {
      const int angle = strip.bin_angle[i];
      const float rest = strip.rest_angle[i];
      const Angles values = kUnit[angle] * std::abs(1 - rest) + kUnit[angle + 1] * std::abs(0 - rest);
      for (int k = 0; k < 4; ++k) sums[k] += strip.weight[k][i] * values;
      ++i;
    } while (i < size && strip.cell[i] == cell);
    upper[0] = sums[0];
    upper[1] = sums[1];
    lower[0] = sums[2];
    lower[1] = sums[3];
  }
}

// Narrows a range of x to where |slope * x + offset| can be less than the limit. inverse: 1 / slope, may be infinite.
void Narrow(double inverse, double offset, double limit, double* begin, double* end) {
  const double one = (-limit - offset) * inverse, other = (limit - offset) * inverse;
  *begin = std::max(*begin, std::min(one, other));
  *end = std::min(*end, std::max(one, other));
}

LAZYLOC_ALWAYS_INLINE inline void FillHistogram(const SiftLevel& level, const SiftKeypoint& keypoint,
                                                double orientation_rad, PaddedHistogram* histogram) {
  const double centre_x = keypoint.x, centre_y = keypoint.y;
  const double bin_size = kBinSizePerScale * keypoint.scale + DBL_EPSILON;
  const Frame frame = {std::cos(orientation_rad), std::sin(orientation_rad), bin_size, orientation_rad};
  const int radius = static_cast<int>(std::floor(std::sqrt(2.0) * bin_size * (kNumSpatialBins + 1) / 2 + 0.5));
  const int x = keypoint.PixelX(), y = keypoint.PixelY();
  const int end_y = std::min(y + radius + 1, level.height - 1);
  GradientStrip gradients;
  Strip strip = {};
  for (int v = std::max(y - radius, 1); v < end_y; ++v) {
    // The bins' square is turned, and most of a row may be outside of it.
    double first = -radius, last = radius;
    const double dy = v - centre_y;
    Narrow(1 / frame.cosine, frame.sine * dy, kReach * bin_size, &first, &last);
    Narrow(-1 / frame.sine, frame.cosine * dy, kReach * bin_size, &first, &last);
    if (first > last + 1) continue;  // the 1 is for the rounding, like the margins below
    const int begin_x = std::max({x - radius, static_cast<int>(std::floor(centre_x + first)) - 1, 1});
    const int end_x = std::min({x + radius + 1, static_cast<int>(std::ceil(centre_x + last)) + 2, level.width - 1});
    for (int u = begin_x; u < end_x; u += kStripSize) {
      const int size = std::min(kStripSize, end_x - u);
      ComputeGradients(level, u, v, size, &gradients);
      FindBins(gradients, frame, u - centre_x, v - centre_y, PaddedSize(size), &strip);
      ComputeWeights(gradients, size, &strip);
      AddToBins(strip, size, histogram);
    }
  }
}

void Normalize(SiftHistogram* histogram) {
  float norm = 0;
  for (const float value : *histogram) norm += value * value;
  norm = SquareRoot(norm) + FLT_EPSILON;
  for (float& value : *histogram) value /= norm;
}

}  // namespace

SiftHistogram DescribeKeypoint(const SiftLevel& level, const SiftKeypoint& keypoint, double orientation_rad) {
  PaddedHistogram padded = {};
  RunVectorized([&]() LAZYLOC_ALWAYS_INLINE { FillHistogram(level, keypoint, orientation_rad, &padded); });
  SiftHistogram histogram;
  for (size_t row = 0; row < kNumSpatialBins; ++row) {
    std::memcpy(&histogram[row * kNumSpatialBins * kNumAngularBins], &padded[(row + 1) * kNumPaddedBins + 1],
                kNumSpatialBins * sizeof(Angles));
  }
  Normalize(&histogram);
  for (float& value : histogram) value = std::min(value, kLimit);
  Normalize(&histogram);
  return histogram;
}

}  // namespace lazyloc

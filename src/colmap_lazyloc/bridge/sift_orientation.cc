#include <algorithm>
#include <array>
#include <cmath>

#include "colmap_lazyloc/bridge/sift_descriptor.h"
#include "colmap_lazyloc/bridge/sift_gradients.h"

namespace lazyloc {
namespace {

constexpr int kNumBins = 36;
constexpr size_t kMaxNumOrientations = 4;
constexpr double kWindowStddev = 1.5;  // of the Gaussian window, in scales of the keypoint
using Histogram = std::array<double, kNumBins>;

// Place of pixels in the window and in the histogram.
struct Strip {
  std::array<double, kStripSize> distance, bin;  // the first one squared
};

LAZYLOC_ALWAYS_INLINE inline void FillHistogram(const SiftLevel& level, const SiftKeypoint& keypoint,
                                                Histogram* histogram) {
  const double centre_x = keypoint.x, centre_y = keypoint.y, window = kWindowStddev * keypoint.scale;
  const int radius = std::max(static_cast<int>(std::floor(3 * window)), 1);
  const int x = keypoint.PixelX(), y = keypoint.PixelY();
  const int end_x = std::min(x + radius + 1, level.width), end_y = std::min(y + radius + 1, level.height);
  GradientStrip gradients;
  Strip strip;
  for (int v = std::max(y - radius, 0); v < end_y; ++v) {
    const double dy = v - centre_y;
    for (int u = std::max(x - radius, 0); u < end_x; u += kStripSize) {
      const int size = std::min(kStripSize, end_x - u);
      ComputeGradients(level, u, v, size, &gradients);
      const int padded = PaddedSize(size);
      for (int i = 0; i < padded; ++i) {
        const double dx = (u + i) - centre_x;
        strip.distance[i] = dx * dx + dy * dy;
        strip.bin[i] = kNumBins * static_cast<double>(gradients.angle[i]) / (2 * M_PI);
      }
      for (int i = 0; i < size; ++i) {
        if (strip.distance[i] >= radius * radius + 0.6) continue;  // the window is a circle
        const double weight = kExponential(strip.distance[i] / (2 * window * window));
        const double place = strip.bin[i] - 0.5;
        const int bin = place < 0 ? -1 : static_cast<int>(place);
        const double rest = strip.bin[i] - bin - 0.5;
        (*histogram)[(bin + kNumBins) % kNumBins] += (1 - rest) * gradients.magnitude[i] * weight;
        (*histogram)[(bin + 1) % kNumBins] += rest * gradients.magnitude[i] * weight;
      }
    }
  }
}

// Replaces each bin by the mean of itself and its neighbours, six times.
LAZYLOC_ALWAYS_INLINE inline void SmoothHistogram(Histogram* histogram) {
  std::array<double, kNumBins + 2> ring;  // with a bin more on both sides
  for (int i = 0; i < 6; ++i) {
    std::copy(histogram->begin(), histogram->end(), ring.begin() + 1);
    ring.front() = histogram->back();
    ring.back() = histogram->front();
    for (int bin = 0; bin < kNumBins; ++bin) (*histogram)[bin] = (ring[bin] + ring[bin + 1] + ring[bin + 2]) / 3.0;
  }
}

}  // namespace

std::vector<double> FindOrientations(const SiftLevel& level, const SiftKeypoint& keypoint) {
  Histogram histogram = {};
  RunVectorized([&]() LAZYLOC_ALWAYS_INLINE {
    FillHistogram(level, keypoint, &histogram);
    SmoothHistogram(&histogram);
  });
  const double threshold = 0.8 * *std::max_element(histogram.begin(), histogram.end());
  std::vector<double> orientations;
  for (int bin = 0; bin < kNumBins && orientations.size() < kMaxNumOrientations; ++bin) {
    const double value = histogram[bin];
    const double before = histogram[(bin + kNumBins - 1) % kNumBins], after = histogram[(bin + 1) % kNumBins];
    if (value <= threshold || value <= before || value <= after) continue;
    const double shift = -0.5 * (after - before) / (after + before - 2 * value);  // to the top of the parabola
    orientations.push_back(2 * M_PI * (bin + shift + 0.5) / kNumBins);
  }
  return orientations;
}

}  // namespace lazyloc

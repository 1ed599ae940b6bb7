#include "colmap_lazyloc/math/smoothing.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "colmap_lazyloc/math/vectorized.h"

namespace lazyloc {
namespace {

constexpr int kNumVectors = 4;  // sums that are computed together
constexpr int kVectorSize = 8;
using Vector = float __attribute__((vector_size(kVectorSize * sizeof(float))));
constexpr int kBlock = kNumVectors * kVectorSize;

// Sets sums[i] for i in [0, kBlock) to the sum of weights[k] * sources[k][begin + i] over all k.
LAZYLOC_ALWAYS_INLINE inline void SumBlock(const std::vector<const float*>& sources, const float* weights, int begin,
                                           float* sums) {
  Vector block[kNumVectors] = {};
  for (size_t k = 0; k < sources.size(); ++k) {
    for (int v = 0; v < kNumVectors; ++v) {
      Vector values;
      std::memcpy(&values, sources[k] + begin + v * kVectorSize, sizeof(values));
      block[v] += weights[k] * values;
    }
  }
  std::memcpy(sums, block, sizeof(block));
}

// Does the same for i in [0, width).
LAZYLOC_ALWAYS_INLINE inline void SumRow(const std::vector<const float*>& sources, const std::vector<float>& weights,
                                         int width, float* sums) {
  if (width >= kBlock) {
    for (int begin = 0; begin < width; begin += kBlock) {
      const int inside = std::min(begin, width - kBlock);  // computes some sums of the last block twice
      SumBlock(sources, weights.data(), inside, sums + inside);
    }
    return;
  }
  for (int i = 0; i < width; ++i) {
    float sum = 0;
    for (size_t k = 0; k < sources.size(); ++k) sum += weights[k] * sources[k][i];
    sums[i] = sum;
  }
}

LAZYLOC_ALWAYS_INLINE inline void SmoothRows(const float* image, int width, int height,
                                             const std::vector<float>& weights, int begin, int end, float* smoothed) {
  const int radius = static_cast<int>(weights.size() / 2);
  std::vector<float> row(static_cast<size_t>(width + 2 * radius));  // with the continued border
  std::vector<const float*> rows(weights.size()), shifts(weights.size());
  for (size_t k = 0; k < shifts.size(); ++k) shifts[k] = &row[k];
  for (int y = begin; y < end; ++y) {
    for (int k = -radius; k <= radius; ++k) {
      const int source = std::clamp(y + k, 0, height - 1);
      rows[static_cast<size_t>(k + radius)] = image + static_cast<size_t>(source) * width;
    }
    SumRow(rows, weights, width, &row[static_cast<size_t>(radius)]);
    std::fill_n(row.begin(), radius, row[static_cast<size_t>(radius)]);
    std::fill_n(row.end() - radius, radius, row[static_cast<size_t>(width + radius - 1)]);
    SumRow(shifts, weights, width, smoothed + static_cast<size_t>(y) * width);
  }
}

}  // namespace

std::vector<float> GaussianWeights(double stddev_px) {
  const int radius = std::max(static_cast<int>(std::ceil(4 * stddev_px)), 1);
  std::vector<float> weights;
  float sum = 0;
  for (int k = -radius; k <= radius; ++k) {
    const float distance = static_cast<float>(k) / static_cast<float>(stddev_px);
    weights.push_back(static_cast<float>(std::exp(-0.5 * static_cast<double>(distance * distance))));
    sum += weights.back();
  }
  for (float& weight : weights) weight /= sum;
  return weights;
}

void Smooth(const float* image, int width, int height, const std::vector<float>& weights, IdleThreads* idle_threads,
            float* smoothed) {
  ParallelForRanges(
      static_cast<size_t>(height),
      [&](size_t begin, size_t end) {
        RunVectorized([&]() LAZYLOC_ALWAYS_INLINE {
          SmoothRows(image, width, height, weights, static_cast<int>(begin), static_cast<int>(end), smoothed);
        });
      },
      idle_threads);
}

}  // namespace lazyloc

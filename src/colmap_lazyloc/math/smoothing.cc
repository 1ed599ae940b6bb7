#include "colmap_lazyloc/math/smoothing.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "colmap_lazyloc/math/vectorized.h"

namespace lazyloc {
namespace {

constexpr int kVectorSize = 8;
using Vector = float __attribute__((vector_size(kVectorSize * sizeof(float))));
constexpr int kNumRows = 4;  // rows whose columns are summed together, because they have most pixels in common

// Sums of `kRows` rows and `kVectors` vectors that are computed together, so that they stay in registers. Sets
// sums[i][x] for x in [begin, begin + kVectors * kVectorSize) to the sum of weights[k * kRows + i] * sources[k][x] over
// all k.
template <int kRows, int kVectors>
LAZYLOC_ALWAYS_INLINE inline void SumBlock(const std::vector<const float*>& sources, const float* weights, int begin,
                                           float* const* sums) {
  Vector block[kRows][kVectors] = {};
  for (int k = 0; k < static_cast<int>(sources.size()); ++k) {
    for (int v = 0; v < kVectors; ++v) {
      Vector values;
      std::memcpy(&values, sources[static_cast<size_t>(k)] + begin + v * kVectorSize, sizeof(values));
      for (int i = 0; i < kRows; ++i) block[i][v] += weights[k * kRows + i] * values;
    }
  }
  for (int i = 0; i < kRows; ++i) std::memcpy(sums[i] + begin, block[i], sizeof(block[i]));
}

// Does the same for x in [0, width).
template <int kRows, int kVectors>
LAZYLOC_ALWAYS_INLINE inline void SumRows(const std::vector<const float*>& sources, const float* weights, int width,
                                          float* const* sums) {
  constexpr int kBlock = kVectors * kVectorSize;
  if (width >= kBlock) {
    for (int begin = 0; begin < width; begin += kBlock) {
      const int inside = std::min(begin, width - kBlock);  // computes some sums of the last block twice
      SumBlock<kRows, kVectors>(sources, weights, inside, sums);
    }
    return;
  }
  for (int i = 0; i < kRows; ++i) {
    for (int x = 0; x < width; ++x) {
      float sum = 0;
      for (int k = 0; k < static_cast<int>(sources.size()); ++k) {
        sum += weights[k * kRows + i] * sources[static_cast<size_t>(k)][x];
      }
      sums[i][x] = sum;
    }
  }
}

LAZYLOC_ALWAYS_INLINE inline void SmoothRowsVectorized(const float* image, int width, int height,
                                                       const std::vector<float>& weights, int begin, int end,
                                                       float* smoothed) {
  const int radius = static_cast<int>(weights.size() / 2);
  // The weights of each source row in the rows; 0 for a row that does not have it, which changes no sum.
  std::vector<float> weights_in_rows((weights.size() + kNumRows - 1) * kNumRows);
  for (size_t i = 0; i < kNumRows; ++i) {
    for (size_t k = 0; k < weights.size(); ++k) weights_in_rows[(k + i) * kNumRows + i] = weights[k];
  }
  const int stride = width + 2 * radius;  // with the continued border
  std::vector<float> columns(static_cast<size_t>(kNumRows) * stride);
  std::vector<const float*> shifts(weights.size()), rows(shifts.size() + kNumRows - 1);
  float* sums[kNumRows];
  for (int i = 0; i < kNumRows; ++i) sums[i] = &columns[static_cast<size_t>(i) * stride + radius];
  for (int y = begin; y < end; y += kNumRows) {
    for (size_t k = 0; k < rows.size(); ++k) {
      const int source = std::clamp(y + static_cast<int>(k) - radius, 0, height - 1);
      rows[k] = image + static_cast<size_t>(source) * width;
    }
    SumRows<kNumRows, 2>(rows, weights_in_rows.data(), width, sums);
    for (int i = 0; i < std::min(kNumRows, end - y); ++i) {
      std::fill_n(sums[i] - radius, radius, sums[i][0]);
      std::fill_n(sums[i] + width, radius, sums[i][width - 1]);
      for (size_t k = 0; k < shifts.size(); ++k) shifts[k] = sums[i] - radius + k;
      float* row = smoothed + static_cast<size_t>(y + i - begin) * width;
      SumRows<1, 8>(shifts, weights.data(), width, &row);
    }
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

void SmoothRows(const float* image, int width, int height, const std::vector<float>& weights, int begin, int end,
                float* smoothed) {
  RunVectorized(
      [&]() LAZYLOC_ALWAYS_INLINE { SmoothRowsVectorized(image, width, height, weights, begin, end, smoothed); });
}

void Smooth(const float* image, int width, int height, const std::vector<float>& weights, IdleThreads* idle_threads,
            float* smoothed) {
  ParallelForRanges(
      static_cast<size_t>(height),
      [&](size_t begin, size_t end) {
        SmoothRows(image, width, height, weights, static_cast<int>(begin), static_cast<int>(end),
                   smoothed + begin * static_cast<size_t>(width));
      },
      idle_threads);
}

}  // namespace lazyloc

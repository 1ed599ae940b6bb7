#include "colmap_lazyloc/math/smoothing.h"

#include <algorithm>
#include <numeric>
#include <random>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

std::vector<float> RandomImage(int width, int height) {
  std::mt19937 random(1);
  std::vector<float> image(static_cast<size_t>(width * height));
  for (float& value : image) value = static_cast<float>(random() % 256) / 255.0f;
  return image;
}

// Convolves the columns, then the rows, term by term.
std::vector<float> SmoothByDefinition(const std::vector<float>& image, int width, int height,
                                      const std::vector<float>& weights) {
  const int radius = static_cast<int>(weights.size() / 2);
  std::vector<float> columns(image.size()), smoothed(image.size());
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int k = -radius; k <= radius; ++k) {
        columns[y * width + x] += weights[k + radius] * image[std::clamp(y + k, 0, height - 1) * width + x];
      }
    }
  }
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int k = -radius; k <= radius; ++k) {
        smoothed[y * width + x] += weights[k + radius] * columns[y * width + std::clamp(x + k, 0, width - 1)];
      }
    }
  }
  return smoothed;
}

TEST(Smooth, IsExact) {
  const std::vector<float> weights = GaussianWeights(1.7);
  for (const int num_idle : {0, 3}) {
    IdleThreads idle_threads(num_idle);
    for (const auto& [width, height] : {std::pair{1, 1}, {3, 200}, {31, 5}, {32, 64}, {33, 65}, {150, 130}}) {
      const std::vector<float> image = RandomImage(width, height);
      std::vector<float> smoothed(image.size());
      Smooth(image.data(), width, height, weights, &idle_threads, smoothed.data());
      EXPECT_EQ(smoothed, SmoothByDefinition(image, width, height, weights)) << width << " x " << height;
    }
  }
}

TEST(SmoothRows, GivesTheRowsOfTheWholeImage) {
  const int width = 70, height = 41;
  const std::vector<float> weights = GaussianWeights(2.4), image = RandomImage(width, height);
  const std::vector<float> expected = SmoothByDefinition(image, width, height, weights);
  for (const auto& [begin, end] : {std::pair{0, 1}, {0, 13}, {7, 30}, {38, 41}}) {
    std::vector<float> rows(static_cast<size_t>((end - begin) * width));
    SmoothRows(image.data(), width, height, weights, begin, end, rows.data());
    EXPECT_TRUE(std::equal(rows.begin(), rows.end(), expected.begin() + begin * width)) << begin;
  }
}

TEST(GaussianWeights, AreSymmetricAndSumUpToOne) {
  const std::vector<float> weights = GaussianWeights(1.1);
  ASSERT_EQ(weights.size(), 11u);
  EXPECT_NEAR(std::accumulate(weights.begin(), weights.end(), 0.0), 1, 1e-6);
  EXPECT_TRUE(std::equal(weights.begin(), weights.end(), weights.rbegin()));
  EXPECT_NEAR(weights[6] / weights[5], std::exp(-0.5 / 1.21), 1e-6);
}

}  // namespace
}  // namespace lazyloc

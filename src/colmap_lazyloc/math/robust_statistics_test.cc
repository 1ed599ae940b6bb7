#include "colmap_lazyloc/math/robust_statistics.h"

#include <random>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

constexpr double kStddev = 3;

// Draws normally distributed values, of which every tenth is far off.
std::vector<double> DrawValues(double mean, uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(mean, kStddev);
  std::vector<double> values;
  for (int i = 0; i < 20000; ++i) values.push_back(i % 10 == 0 ? 1e6 * (i % 20 == 0 ? 1 : -1) : normal(random));
  return values;
}

TEST(Median, IsTheUpperOne) {
  EXPECT_EQ(Median({3}), 3);
  EXPECT_EQ(Median({5, 1, 3}), 3);
  EXPECT_EQ(Median({5, 1, 4, 3}), 4);
}

TEST(HarmonicMean, IsTheInverseOfTheMeanInverse) { EXPECT_DOUBLE_EQ(HarmonicMean({1, 2, 4}), 3 / 1.75); }

// One false value in ten shifts the median's rank by a tenth of the distribution, i.e. its size by a sixth.
TEST(RobustStddev, HardlyChangesWithFalseValues) {
  EXPECT_NEAR(RobustStddev(DrawValues(100, 1)), kStddev, 0.2 * kStddev);
  std::vector<double> sizes;
  for (const double value : DrawValues(0, 2)) sizes.push_back(std::abs(value));
  EXPECT_NEAR(StddevOfSizes(sizes), kStddev, 0.2 * kStddev);
}

TEST(RobustStddev, IsThatOfNormallyDistributedErrors) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal(0, kStddev);
  std::vector<double> values, sizes, lengths;
  for (int i = 0; i < 100000; ++i) {
    values.push_back(50 + normal(random));
    sizes.push_back(std::abs(normal(random)));
    const double x = normal(random), y = normal(random);
    lengths.push_back(std::hypot(x, y));
  }
  EXPECT_NEAR(RobustStddev(values), kStddev, 0.02 * kStddev);
  EXPECT_NEAR(StddevOfSizes(sizes), kStddev, 0.02 * kStddev);
  EXPECT_NEAR(StddevOfLengths(lengths), kStddev, 0.02 * kStddev);
}

}  // namespace
}  // namespace lazyloc

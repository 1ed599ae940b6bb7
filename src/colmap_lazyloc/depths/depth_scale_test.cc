#include "colmap_lazyloc/depths/depth_scale.h"

#include <cmath>
#include <functional>
#include <random>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

constexpr int kNumPoints = 400;

// Makes samples of points at distances of 2 to 6. map_depth: of a true depth and the point's place.
template <typename MapDepth>
std::vector<DepthSample> MakeSamples(const MapDepth& map_depth, int num_points = kNumPoints) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<DepthSample> samples;
  for (int i = 0; i < num_points; ++i) {
    const double depth = 2 + 4 * uniform(random);
    const Eigen::Vector2d place{uniform(random), uniform(random)};
    samples.push_back({map_depth(depth, place), depth, place});
  }
  return samples;
}

std::function<double()> Noise(double stddev) {
  return [random = std::mt19937(2), normal = std::normal_distribution<double>(0, stddev)]() mutable {
    return normal(random);
  };
}

TEST(FitDepthMap, FindsScaleAndSpreadDespiteOutliers) {
  auto noise = Noise(0.05);
  int i = 0;
  const DepthFit fit = FitDepthMap(
      MakeSamples([&](double depth, const auto&) { return ++i % 5 == 0 ? 1 : depth / 3 * std::exp(noise()); }));
  EXPECT_EQ(fit.verdict, DepthVerdict::USED);
  EXPECT_EQ(fit.num_points, kNumPoints);
  EXPECT_NEAR(fit.log_scale, std::log(3), 0.02);
  EXPECT_NEAR(fit.stddev, 0.06, 0.02);
}

TEST(FitDepthMap, ScaleOfIndependentErrorsIsMoreCertainThanOneDepth) {
  auto noise = Noise(0.05);
  const DepthFit fit = FitDepthMap(MakeSamples([&](double depth, const auto&) { return depth * std::exp(noise()); }));
  EXPECT_NEAR(std::sqrt(fit.pixel_variance), 0.05, 0.005);
  EXPECT_LE(std::sqrt(fit.scale_variance), 0.007);
  EXPECT_LE(std::abs(fit.log_scale), 3 * std::sqrt(fit.scale_variance));
}

TEST(FitDepthMap, ScaleOfSmoothErrorsIsHardlyMoreCertainThanOneDepth) {
  const DepthFit fit = FitDepthMap(MakeSamples(
      [](double depth, const Eigen::Vector2d& place) { return depth * std::exp(0.1 * std::sin(6 * place.x())); }));
  EXPECT_EQ(fit.verdict, DepthVerdict::USED);
  EXPECT_GE(std::sqrt(fit.common_variance), 0.01);  // 0.07 over the root of 16 cells, in columns
  EXPECT_LE(fit.pixel_variance, 0.3 * fit.stddev * fit.stddev);
}

TEST(FitDepthMap, SpreadHasAMinimum) {
  const DepthFit fit = FitDepthMap(MakeSamples([](double depth, const auto&) { return depth; }));
  EXPECT_EQ(fit.stddev, kMinDepthStddev);
  EXPECT_GE(std::sqrt(fit.scale_variance), 0.1 * kMinDepthStddev);
}

TEST(FitDepthMap, WrongMapsAreContradicted) {
  auto noise = Noise(0.5);
  const auto verdict = [](const std::vector<DepthSample>& samples) { return FitDepthMap(samples).verdict; };
  EXPECT_EQ(verdict(MakeSamples([&](double, const auto&) { return std::exp(noise()); })), DepthVerdict::CONTRADICTED);
  EXPECT_EQ(verdict(MakeSamples([](double depth, const auto&) { return 1 / depth; })), DepthVerdict::CONTRADICTED);
  EXPECT_EQ(verdict(MakeSamples([](double, const Eigen::Vector2d& place) { return 2 + place.y(); })),
            DepthVerdict::CONTRADICTED);
}

TEST(FitDepthMap, FewPointsTellNothing) {
  const auto samples = MakeSamples([](double depth, const auto&) { return depth; }, /*num_points=*/9);
  EXPECT_EQ(FitDepthMap(samples).verdict, DepthVerdict::NO_SCALE);
}

// Returns a fit of exact points to a map whose depths are too small by a factor.
DepthFit OwnFit(double factor) {
  return FitDepthMap(MakeSamples([&](double depth, const auto&) { return depth / factor; }));
}

TEST(FitMetricDepthMap, WithoutPointsTheStatementDecides) {
  const DepthFit fit = FitMetricDepthMap({}, {});
  EXPECT_EQ(fit.verdict, DepthVerdict::USED);
  EXPECT_EQ(fit.log_scale, 0);
  EXPECT_GE(std::sqrt(fit.scale_variance), kMetricScaleStddev);
}

TEST(FitMetricDepthMap, PointsOfUnknownScaleTellTheSpread) {
  auto noise = Noise(0.1);
  const auto samples = MakeSamples([&](double depth, const auto&) { return depth / 7 * std::exp(noise()); });
  const DepthFit fit = FitMetricDepthMap({}, FitDepthMap(samples));
  EXPECT_EQ(fit.verdict, DepthVerdict::USED);
  EXPECT_EQ(fit.log_scale, 0);
  EXPECT_NEAR(fit.stddev, 0.1, 0.02);
  const auto wrong = MakeSamples([](double depth, const auto&) { return 1 / depth; });
  EXPECT_EQ(FitMetricDepthMap({}, FitDepthMap(wrong)).verdict, DepthVerdict::CONTRADICTED);
}

TEST(FitMetricDepthMap, PointsContradictAScaleThatIsFarOff) {
  const DepthFit near = FitMetricDepthMap(OwnFit(1.02), {}), far = FitMetricDepthMap(OwnFit(3), {});
  EXPECT_TRUE(near.is_metric);
  EXPECT_GT(near.log_scale, 0);
  EXPECT_LT(near.log_scale, std::log(1.02));
  EXPECT_LT(near.scale_variance, OwnFit(1.02).scale_variance);
  EXPECT_FALSE(far.is_metric);
  EXPECT_NEAR(far.log_scale, std::log(3), 1e-12);
}

}  // namespace
}  // namespace lazyloc

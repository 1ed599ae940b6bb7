#include "colmap_lazyloc/noise/variance_estimate.h"

#include <cmath>
#include <limits>
#include <numeric>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

constexpr int kNumFrames = 10;
constexpr ExpectedStddev kAnything{1, 100, 1e-3, 0.3};

PriorGroup MakeGroup(const std::vector<VarianceComponent>& components) {
  PriorGroup group{std::vector<int>(kNumFrames), components};
  std::iota(group.frames.begin(), group.frames.end(), 0);
  return group;
}

Eigen::MatrixXd Identity() { return Eigen::MatrixXd::Identity(kNumFrames, kNumFrames); }

// Returns the fit of an adjustment under independent priors of unit variance, if images alone find these deviations
// with the same information on each.
PriorFit MakeFit(const Eigen::Matrix<double, kNumFrames, 6>& deviations, double information) {
  return {deviations * information / (information + 1),
          information * Eigen::MatrixXd::Identity(6 * kNumFrames, 6 * kNumFrames)};
}

TEST(EstimateVariances, TakesTheNoiseOfTheImagesFromTheDeviations) {
  const PriorGroup group = MakeGroup({{Identity(), 1}});
  const PriorFit fit = MakeFit(Eigen::MatrixXd::Constant(kNumFrames, 6, 2), 0.25);
  // The images' noise has a variance of 4 times the factor.
  EXPECT_NEAR(EstimateVariances(group, fit, 0.1, {kAnything}).variances[0], 4 - 0.4, 0.3);
  EXPECT_NEAR(EstimateVariances(group, fit, 0.5, {kAnything}).variances[0], 4 - 2, 0.3);
  EXPECT_LE(EstimateVariances(group, fit, 1.5, {kAnything}).variances[0], 0.01) << "noise alone explains more";
}

TEST(EstimateVariances, TellsRotationsFromPositions) {
  const PriorGroup group = MakeGroup({{Identity(), 1, PosePart::ROTATION}, {Identity(), 1, PosePart::POSITION}});
  Eigen::MatrixXd deviations(kNumFrames, 6);
  deviations.leftCols<3>().setConstant(0.5);
  deviations.rightCols<3>().setConstant(3);
  const std::vector<double> variances =
      EstimateVariances(group, MakeFit(deviations, 1e6), 1, {kAnything, kAnything}).variances;
  EXPECT_NEAR(variances[0], 0.25, 0.02);
  EXPECT_NEAR(variances[1], 9, 0.5);
}

TEST(EstimateVariances, TellsSharedFromIndependentDeviations) {
  const PriorGroup group = MakeGroup({{Eigen::MatrixXd::Ones(kNumFrames, kNumFrames), 1}, {Identity(), 1}});
  Eigen::MatrixXd deviations = Eigen::MatrixXd::Constant(kNumFrames, 6, 3);
  for (int i = 0; i < kNumFrames; ++i) deviations.row(i).array() += i % 2 == 0 ? 0.5 : -0.5;
  PriorFit fit = MakeFit(deviations, 1e6);
  fit.deviations = deviations;  // so well known that the priors hardly matter
  const std::vector<double> variances = EstimateVariances(group, fit, 1, {kAnything, kAnything}).variances;
  EXPECT_NEAR(variances[0], 9, 1);
  EXPECT_NEAR(variances[1], 0.25 * kNumFrames / (kNumFrames - 1), 0.03);
}

TEST(EstimateVariances, FindsTheErrorsOfGps) {
  const PriorGroup group = MakeGroup({{Identity(), 1}});
  const PriorFit fit = MakeFit(Eigen::MatrixXd::Constant(kNumFrames, 6, 25), 1e6);
  EXPECT_NEAR(std::sqrt(EstimateVariances(group, fit, 1, {kAnything}).variances[0]), 25, 2);
}

TEST(EstimateVariances, WithoutInformationIsTheExpectation) {
  const PriorGroup group = MakeGroup({{Identity(), 4}});
  const PriorFit fit = MakeFit(Eigen::MatrixXd::Zero(kNumFrames, 6), 0);
  EXPECT_NEAR(EstimateVariances(group, fit, 1, {{3, 1, 0.1, 1}}).variances[0], 9, 1e-6);
}

TEST(EstimateVariances, WithoutAValidLikelihoodIsTheExpectation) {
  const PriorGroup group = MakeGroup({{Identity(), 4}});
  for (const double information : {-1e9, std::numeric_limits<double>::quiet_NaN()}) {
    const PriorFit fit = MakeFit(Eigen::MatrixXd::Zero(kNumFrames, 6), information);
    EXPECT_NEAR(EstimateVariances(group, fit, 1, {{3, 1, 0.1, 1}}).variances[0], 9, 1e-9);
  }
}

TEST(EstimateVariances, IsBetweenTheExpectationAndTheImages) {
  const PriorGroup group = MakeGroup({{Identity(), 1}});
  const PriorFit fit = MakeFit(Eigen::MatrixXd::Constant(kNumFrames, 6, 2), 1e6);
  // The root of 60 (4 / variance - 1) = log(stddev) / log_stddev^2, for 60 deviations.
  EXPECT_NEAR(EstimateVariances(group, fit, 1, {{1, 0.2, 0.1, 1}}).variances[0], 3.2, 0.3);
  EXPECT_DOUBLE_EQ(EstimateVariances(group, fit, 1, {{5, 1, 4, 5}}).variances[0], 16) << "the minimum";
}

TEST(EstimateVariances, EvidenceTellsDeviationsFromNone) {
  const PriorGroup group = MakeGroup({{Identity(), 1}});
  const ExpectedStddev expected{1, 1, 0.01, 1};
  const auto log_bayes_factor = [&](double deviation, double information) {
    const PriorFit fit = MakeFit(Eigen::MatrixXd::Constant(kNumFrames, 6, deviation), information);
    return EstimateVariances(group, fit, 1, {expected}).log_bayes_factor;
  };
  EXPECT_GT(log_bayes_factor(2, 100), 100);
  // Of deviations as large as the noise, the expected sizes explain nothing that the noise does not.
  EXPECT_LT(log_bayes_factor(0.01, 1e4), -3);
  EXPECT_LT(log_bayes_factor(0.01, 1e4), log_bayes_factor(0.1, 100)) << "less information rules out fewer sizes";
  EXPECT_NEAR(log_bayes_factor(0, 0), 0, 1e-6) << "images that say nothing";
}

}  // namespace
}  // namespace lazyloc

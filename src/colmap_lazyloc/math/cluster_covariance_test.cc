#include "colmap_lazyloc/math/cluster_covariance.h"

#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

constexpr int kNumObservations = 20;  // of a cluster
constexpr int kNumTrials = 400;

struct MeanCovariances {
  Eigen::Matrix2d true_one = Eigen::Matrix2d::Zero();  // of the estimates
  Eigen::Matrix2d independent = true_one;              // as independent observations have it, mean over the trials
  Eigen::Matrix2d excess = true_one;                   // mean over the trials
  double small_sample_factor = 0;
};

// Estimates the mean of observations with unit noise whose first coordinate has an error common to each cluster.
MeanCovariances EstimateMeans(int num_clusters, double common_stddev) {
  std::mt19937 generator(1);
  std::normal_distribution<double> normal;
  const double num = num_clusters * kNumObservations;
  MeanCovariances covariances;
  for (int trial = 0; trial < kNumTrials; ++trial) {
    std::vector<Eigen::Vector2d> observations;
    Eigen::Vector2d mean(0, 0);
    for (int cluster = 0; cluster < num_clusters; ++cluster) {
      const double common = common_stddev * normal(generator);
      for (int i = 0; i < kNumObservations; ++i) {
        const double x = normal(generator), y = normal(generator);
        observations.emplace_back(x + common, y);
        mean += observations.back() / num;
      }
    }
    ClusterCovariance<2> clusters;
    Eigen::Matrix2d independent = Eigen::Matrix2d::Zero();
    for (size_t i = 0; i < observations.size(); ++i) {
      const Eigen::Vector2d influence = (observations[i] - mean) / num;
      clusters.Add(static_cast<int>(i) / kNumObservations, influence);
      independent += influence * influence.transpose();
    }
    covariances.true_one += mean * mean.transpose() / kNumTrials;
    covariances.independent += independent / kNumTrials;
    covariances.excess += clusters.Excess(independent) / kNumTrials;
    covariances.small_sample_factor = clusters.SmallSampleFactor(1);
  }
  return covariances;
}

TEST(ClusterCovariance, ExcessIsWhatCommonErrorsAdd) {
  // A sample variance of 400 trials is off by sqrt(2 / 400) = 7 %.
  const MeanCovariances covariances = EstimateMeans(/*num_clusters=*/30, /*common_stddev=*/1);
  const Eigen::Matrix2d sum = covariances.independent + covariances.excess;
  EXPECT_NEAR(sum(0, 0) / covariances.true_one(0, 0), 1, 0.25);
  EXPECT_GT(covariances.excess(0, 0), 5 * covariances.independent(0, 0));
  // The positive part of what is zero on average adds about half of its standard deviation, sqrt(2 / 30).
  EXPECT_LT(covariances.excess(1, 1), 0.3 * covariances.independent(1, 1));
}

TEST(ClusterCovariance, IndependentObservationsHaveLittleExcess) {
  const MeanCovariances covariances = EstimateMeans(/*num_clusters=*/30, /*common_stddev=*/0);
  EXPECT_LT(covariances.excess.trace(), 0.3 * covariances.independent.trace());
  EXPECT_GE(covariances.excess.trace(), 0);
}

TEST(ClusterCovariance, FewClustersDoNotMakeItTooSmall) {
  const MeanCovariances covariances = EstimateMeans(/*num_clusters=*/4, /*common_stddev=*/1);
  const Eigen::Matrix2d sum = covariances.small_sample_factor * (covariances.independent + covariances.excess);
  EXPECT_NEAR(sum(0, 0) / covariances.true_one(0, 0), 1, 0.25);
}

TEST(ClusterCovariance, DoesNotDependOnUnits) {
  std::mt19937 generator(2);
  std::normal_distribution<double> normal;
  const Eigen::Vector2d units(1e-3, 50);
  ClusterCovariance<2> clusters, scaled;
  Eigen::Matrix2d independent = Eigen::Matrix2d::Zero();
  for (int i = 0; i < 60; ++i) {
    const Eigen::Vector2d influence{normal(generator) + i % 10, normal(generator)};
    clusters.Add(i % 10, influence);
    scaled.Add(i % 10, units.cwiseProduct(influence));
    independent += influence * influence.transpose();
  }
  const Eigen::Matrix2d excess = clusters.Excess(independent);
  const Eigen::Matrix2d expected = units.asDiagonal() * excess * units.asDiagonal();
  const Eigen::Matrix2d covariance = units.asDiagonal() * independent * units.asDiagonal();
  EXPECT_LE((scaled.Excess(covariance) - expected).norm(), 1e-9 * expected.norm());
}

TEST(ClusterCovariance, SmallSampleFactorIsBounded) {
  ClusterCovariance<2> clusters;
  const std::vector<double> factors = {3, 3, 3, 3, 5.0 / 2, 2, 7.0 / 4};  // of one to seven clusters
  for (size_t i = 0; i < factors.size(); ++i) {
    clusters.Add(static_cast<int>(i), {1, 0});
    EXPECT_DOUBLE_EQ(clusters.SmallSampleFactor(3), factors[i]);
  }
}

TEST(ClusterCovariance, OneClusterHasNone) {
  ClusterCovariance<2> clusters;
  for (const double sign : {1, -1}) clusters.Add(0, {sign, 2 * sign});
  EXPECT_EQ(clusters.Excess(Eigen::Matrix2d::Identity()), Eigen::Matrix2d::Zero());
}

TEST(ClusterCovariance, APriorIsNotAnErrorOfClusters) {
  // All observations pull alike, away from a prior.
  ClusterCovariance<2> clusters;
  for (int i = 0; i < 40; ++i) clusters.Add(i % 8, {1, 0.5});
  EXPECT_EQ(clusters.Excess(Eigen::Matrix2d::Identity()), Eigen::Matrix2d::Zero());
}

}  // namespace
}  // namespace lazyloc

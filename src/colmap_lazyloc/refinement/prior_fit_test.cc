#include "colmap_lazyloc/refinement/prior_fit.h"

#include <cmath>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/refinement/pose_prior.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

constexpr int kNumDatabase = 12;
constexpr double kKeypointNoisePx = 0.5;

// Returns the shape of errors that a random walk from frame to frame adds up.
Eigen::MatrixXd WalkShape() {
  Eigen::MatrixXd shape(kNumDatabase, kNumDatabase);
  for (int i = 0; i < kNumDatabase; ++i) {
    for (int j = 0; j < kNumDatabase; ++j) shape(i, j) = std::min(i, j) + 1;
  }
  return shape;
}

struct Noise {
  double walk_px, independent_px;
};

// A scene whose database poses are off by a walk and by independent errors.
struct Trial {
  SyntheticTracks scene;
  Rigid3d query_truth;
};

Trial MakeTrial(const Noise& noise, uint32_t seed) {
  SyntheticTracksOptions options;
  options.num_points = 300;
  options.num_database = kNumDatabase;
  options.noise_px = kKeypointNoisePx;
  options.seed = seed;
  Trial trial{MakeSyntheticTracks(options), {}};
  PosedImages& posed = trial.scene.posed;
  trial.query_truth = CamFromWorld(posed, 0);
  const std::vector<FrameScale> scales = MeasureFrameScales(posed, trial.scene.tracks);
  Random random(seed + 100);
  Eigen::Vector3d walk_rotation = Eigen::Vector3d::Zero(), walk_position = Eigen::Vector3d::Zero();
  PriorGroup group;
  for (int i = 1; i <= kNumDatabase; ++i) {
    posed.images[i].noise_px = kKeypointNoisePx;
    Rigid3d& pose = posed.frames[i].frame_from_world;
    const PosePrior one_px = MakePosePrior(pose, 1, scales[1]);
    walk_rotation += noise.walk_px * RandomVector(&random);
    walk_position += noise.walk_px * RandomVector(&random);
    const Eigen::Vector3d rotation = walk_rotation + noise.independent_px * RandomVector(&random);
    const Eigen::Vector3d position = walk_position + noise.independent_px * RandomVector(&random);
    pose = CamFromWorld(pose.rotation * ExpSO3(one_px.rotation_stddev_rad * rotation),
                        CamInWorld(pose) + one_px.position_stddev * position);
    posed.frames[i].prior = MakePosePrior(pose, 1, scales[1]);
    group.frames.push_back(i);
  }
  group.components = {{WalkShape(), 1}, {Eigen::MatrixXd::Identity(kNumDatabase, kNumDatabase), 1}};
  posed.prior_groups = {group};
  return trial;
}

// Adjusts until the estimates have settled.
BundleAdjustmentResult AdjustAndEstimate(SyntheticTracks scene) {
  BundleAdjustmentResult result;
  for (int i = 0; i < 20; ++i) {
    result = AdjustBundle(scene.posed, scene.tracks, {});
    EXPECT_TRUE(result.summary.success);
    const double factor = VarianceFactor(result.posed, result.tracks, RobustLoss(2));
    PriorGroup& group = result.posed.prior_groups[0];
    const std::vector<double> variances = EstimateVariances(group, result.prior_fits[0], factor, {{1, 0.1}, {1, 0.1}});
    for (int j : {0, 1}) group.components[j].variance = variances[j];
    scene = {result.posed, result.tracks};
  }
  return result;
}

class DatabaseNoises : public testing::TestWithParam<Noise> {};

TEST_P(DatabaseNoises, AreFoundAndExplainTheQuerysError) {
  double walk = 0, independent = 0, squared_error = 0;
  constexpr int kNumTrials = 8;
  for (uint32_t seed = 0; seed < kNumTrials; ++seed) {
    const Trial trial = MakeTrial(GetParam(), seed);
    const BundleAdjustmentResult result = AdjustAndEstimate(trial.scene);
    const std::vector<VarianceComponent>& components = result.posed.prior_groups[0].components;
    walk += components[0].variance / kNumTrials;
    independent += components[1].variance / kNumTrials;
    const Rigid3d pose = CamFromWorld(result.posed, 0);
    const Eigen::Vector3d error = CamInWorld(pose) - CamInWorld(trial.query_truth);
    squared_error += error.dot(PositionCovariance(pose, result.image_covariances[0]).llt().solve(error)) / kNumTrials;
  }
  // Allows for chance: 12 frames have 72 deviations, blurred by those of the other component and of the keypoints.
  EXPECT_NEAR(std::sqrt(walk), GetParam().walk_px, 0.3 * GetParam().walk_px + 0.7);
  EXPECT_NEAR(std::sqrt(independent), GetParam().independent_px, 0.3 * GetParam().independent_px + 0.7);
  EXPECT_GE(squared_error, 0.8) << "3 degrees of freedom";
  EXPECT_LE(squared_error, 9);
}

INSTANTIATE_TEST_SUITE_P(PriorFit, DatabaseNoises,
                         testing::Values(Noise{0, 2}, Noise{2, 0}, Noise{2, 2}, Noise{0.5, 5}));

// Checks the parts of the covariance against the difference that a component's variance makes.
TEST(PriorFit, PartsOfTheCovarianceAddUp) {
  const Trial trial = MakeTrial({1, 1}, 1);
  const BundleAdjustmentResult result = AdjustBundle(trial.scene.posed, trial.scene.tracks, {});
  ASSERT_EQ(result.prior_fits.size(), 1u);
  const auto& parts = result.prior_fits[0].image_parts;
  ASSERT_EQ(parts.size(), 2u);
  constexpr double kStep = 1e-4;
  for (int j : {0, 1}) {
    SyntheticTracks changed{result.posed, result.tracks};
    changed.posed.prior_groups[0].components[j].variance += kStep;
    const Eigen::Matrix<double, 6, 6> change = AdjustBundle(changed.posed, changed.tracks, {}).image_covariances[0] -
                                               AdjustBundle(result.posed, result.tracks, {}).image_covariances[0];
    EXPECT_LE((change / kStep - parts[j][0]).norm(), 0.02 * parts[j][0].norm());
    EXPECT_TRUE(parts[j][1].isZero(0)) << "a database image";
  }
}

TEST(PriorFit, WithoutTheParameterTheBestEstimateIsTheExpectation) {
  const PriorGroup group{{1}, {{Eigen::MatrixXd::Identity(1, 1), 4}}};
  PriorFit fit{Eigen::MatrixXd::Zero(1, 6), Eigen::MatrixXd::Constant(1, 1, 24), {}};  // spread as wide as the prior
  EXPECT_DOUBLE_EQ(EstimateVariances(group, fit, 1, {{9, 1}})[0], 9);
}

}  // namespace
}  // namespace lazyloc

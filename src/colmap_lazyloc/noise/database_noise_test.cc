#include <cmath>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/noise/variance_estimate.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/refinement/pose_prior.h"
#include "colmap_lazyloc/refinement/prior_precision.h"
#include "colmap_lazyloc/scene/pose_distribution.h"
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
  double walk_px, rotation_px, position_px;
};

// A scene whose database poses are off by a walk and by independent errors of rotations and positions.
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
    const Eigen::Vector3d rotation = walk_rotation + noise.rotation_px * RandomVector(&random);
    const Eigen::Vector3d position = walk_position + noise.position_px * RandomVector(&random);
    pose = CamFromWorld(pose.rotation * ExpSO3(one_px.rotation_stddev_rad * rotation),
                        CamInWorld(pose) + one_px.position_stddev * position);
    posed.frames[i].prior = MakePosePrior(pose, 1, scales[1]);
    group.frames.push_back(i);
  }
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(kNumDatabase, kNumDatabase);
  group.components = {{WalkShape(), 1}, {identity, 1, PosePart::ROTATION}, {identity, 1, PosePart::POSITION}};
  posed.prior_groups = {group};
  return trial;
}

// Adjusts until the estimates have settled.
BundleAdjustmentResult AdjustAndEstimate(SyntheticTracks scene) {
  BundleAdjustmentOptions options;
  options.convergence_sigma = 0.01;
  BundleAdjustmentResult result;
  for (int i = 0; i < 4; ++i) {
    result = AdjustBundle(scene.posed, scene.tracks, options);
    EXPECT_TRUE(result.summary.success);
    const double factor = VarianceFactor(result.posed, result.tracks, RobustLoss(2));
    PriorGroup& group = result.posed.prior_groups[0];
    const ExpectedStddev walk{1, 1, 0.01, 0.1}, independent{1, 1, 0.01, 1};
    const std::vector<double> variances =
        EstimateVariances(group, result.prior_fits[0], factor, {walk, independent, independent}).variances;
    for (int j : {0, 1, 2}) group.components[j].variance = variances[j] / factor;
    scene = {result.posed, result.tracks};
  }
  return result;
}

class DatabaseNoises : public testing::TestWithParam<Noise> {};

TEST_P(DatabaseNoises, AreFoundAndExplainTheQuerysError) {
  Eigen::Array3d variances = Eigen::Array3d::Zero();
  double squared_error = 0;
  constexpr int kNumTrials = 8;
  for (uint32_t seed = 0; seed < kNumTrials; ++seed) {
    const Trial trial = MakeTrial(GetParam(), seed);
    const BundleAdjustmentResult result = AdjustAndEstimate(trial.scene);
    const double factor = VarianceFactor(result.posed, result.tracks, RobustLoss(2));
    const std::vector<VarianceComponent>& components = result.posed.prior_groups[0].components;
    for (int j : {0, 1, 2}) variances[j] += factor * components[j].variance / kNumTrials;
    const Rigid3d pose = CamFromWorld(result.posed, 0);
    const Eigen::Vector3d error = CamInWorld(pose) - CamInWorld(trial.query_truth);
    const Eigen::Matrix3d covariance =
        MakePoseDistribution(pose, factor * result.image_covariances[0]).PositionCovariance();
    squared_error += error.dot(covariance.llt().solve(error)) / kNumTrials;
  }
  // Allows for chance: 12 frames have 36 deviations of each kind, blurred by those of the walk and of the keypoints.
  EXPECT_NEAR(std::sqrt(variances[0]), GetParam().walk_px, 0.3 * GetParam().walk_px + 0.8);
  EXPECT_NEAR(std::sqrt(variances[1]), GetParam().rotation_px, 0.3 * GetParam().rotation_px + 0.8);
  EXPECT_NEAR(std::sqrt(variances[2]), GetParam().position_px, 0.3 * GetParam().position_px + 0.8);
  EXPECT_GE(squared_error, 0.8) << "3 degrees of freedom";
  EXPECT_LE(squared_error, 9);
}

INSTANTIATE_TEST_SUITE_P(PriorFit, DatabaseNoises,
                         testing::Values(Noise{0, 2, 2}, Noise{2, 0, 0}, Noise{2, 2, 2}, Noise{0.5, 5, 5},
                                         Noise{0, 3, 0}, Noise{0, 0, 3}));

// Checks the information against the covariance of the database poses, which the priors and the images determine.
TEST(PriorFit, InformationIsThatOfTheImages) {
  const Trial trial = MakeTrial({1, 1, 0}, 1);
  BundleAdjustmentOptions options;
  options.convergence_sigma = 1e-6;
  const BundleAdjustmentResult result = AdjustBundle(trial.scene.posed, trial.scene.tracks, options);
  ASSERT_EQ(result.prior_fits.size(), 1u);
  Eigen::MatrixXd information = result.prior_fits[0].information;
  const PriorPrecision precision = ComputePriorPrecision(result.posed.prior_groups[0]);
  for (int k = 0; k < 6; ++k) {
    information.block<kNumDatabase, kNumDatabase>(k * kNumDatabase, k * kNumDatabase) += precision.Of(k);
  }
  const Eigen::MatrixXd covariance = information.llt().solve(Eigen::MatrixXd::Identity(72, 72));
  for (int i = 0; i < kNumDatabase; ++i) {
    const int frame = i + 1;
    const PosePriorResidual deviation =
        EvaluatePosePrior(*result.posed.frames[frame].prior, result.posed.frames[frame].frame_from_world);
    EXPECT_TRUE(result.prior_fits[0].deviations.row(i).isApprox(deviation.error.transpose(), 1e-9));
    const Eigen::Matrix<double, 6, 6> expected =
        deviation.jacobian * result.frame_covariances[frame] * deviation.jacobian.transpose();
    const Eigen::Matrix<double, 6, 6> found =
        covariance(Eigen::seqN(i, 6, kNumDatabase), Eigen::seqN(i, 6, kNumDatabase));
    EXPECT_LE((found - expected).norm(), 1e-3 * expected.norm()) << i;
  }
}

// Checks the covariances that components cause against the difference that a component's variance makes.
TEST(PriorFit, PartsOfTheCovarianceAddUp) {
  const Trial trial = MakeTrial({1, 1, 1}, 1);
  const BundleAdjustmentResult result = AdjustBundle(trial.scene.posed, trial.scene.tracks, {});
  ASSERT_EQ(result.prior_fits.size(), 1u);
  const auto& covariances = result.prior_fits[0].component_covariances;
  ASSERT_EQ(covariances.size(), 3u);
  constexpr double kStep = 1e-4;
  for (int j : {0, 1, 2}) {
    SyntheticTracks changed{result.posed, result.tracks};
    changed.posed.prior_groups[0].components[j].variance += kStep;
    const Eigen::Matrix<double, 6, 6> change = AdjustBundle(changed.posed, changed.tracks, {}).image_covariances[0] -
                                               AdjustBundle(result.posed, result.tracks, {}).image_covariances[0];
    EXPECT_LE((change / kStep - covariances[j][0]).norm(), 0.02 * covariances[j][0].norm());
    EXPECT_TRUE(covariances[j][1].isZero(0)) << "a database image";
  }
}

}  // namespace
}  // namespace lazyloc

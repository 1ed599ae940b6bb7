#include "colmap_lazyloc/refinement/pose_prior.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

constexpr double kFocalLengthPx = 500;

TEST(PosePrior, JacobianIsTheDerivative) {
  Random random(1);
  const Rigid3d given = LookAt({1, 2, -8}, {0, 0, 0});
  const PosePrior prior{given, 0.01, 0.2};
  const Rigid3d pose{Disturbed(given.rotation, 0.05, &random), given.translation + 0.3 * RandomVector(&random)};
  const PosePriorResidual residual = EvaluatePosePrior(prior, pose);
  constexpr double kStep = 1e-6;
  for (int i = 0; i < 6; ++i) {
    const auto moved = [&](double step) {
      Eigen::Matrix<double, 6, 1> move = step * Eigen::Matrix<double, 6, 1>::Unit(i);
      return EvaluatePosePrior(prior, {ExpSO3(move.head<3>()) * pose.rotation, pose.translation + move.tail<3>()})
          .error;
    };
    const Eigen::Matrix<double, 6, 1> numeric = (moved(kStep) - moved(-kStep)) / (2 * kStep);
    // The analytic one is to first order in the rotation's deviation, here about 1e-3 rad.
    EXPECT_LE((numeric - residual.jacobian.col(i)).norm(), 2e-3 * numeric.norm()) << i;
  }
}

TEST(PosePrior, ScalesAreFocalLengthAndDistance) {
  const SyntheticTracks scene = MakeSyntheticTracks({});
  const std::vector<ViewScale> scales = MeasureViewScales(scene.views, scene.tracks);
  ASSERT_EQ(scales.size(), scene.views.size());
  for (size_t view = 0; view < scales.size(); ++view) {
    EXPECT_NEAR(scales[view].focal_length_px, kFocalLengthPx, 1);
    EXPECT_NEAR(scales[view].distance, MedianDistance(scene.views[view], scene.tracks), 1e-12);
  }
  const PosePrior prior = MakePosePrior(scene.views[1].cam_from_world, 2, scales[1]);
  EXPECT_NEAR(prior.rotation_stddev_rad, 2 / kFocalLengthPx, 1e-5);
  EXPECT_NEAR(prior.position_stddev, 2 * scales[1].distance / kFocalLengthPx, 1e-4);
}

// Database poses off by noise_px, and what is left of the query's error and of the unknown noise after four rounds.
struct Trial {
  double exact_error, soft_error, estimated_px;
};
Trial RunTrial(double noise_px, uint32_t seed) {
  SyntheticTracksOptions options;
  options.num_points = 300;
  options.num_database = 12;
  options.noise_px = 0.5;
  options.seed = seed;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  const Rigid3d truth = scene.views[0].cam_from_world;
  const std::vector<ViewScale> scales = MeasureViewScales(scene.views, scene.tracks);
  Random random(seed + 100);
  for (size_t view = 1; view < scene.views.size(); ++view) {
    scene.views[view].noise_px = 0.5;
    const PosePrior noise = MakePosePrior(scene.views[view].cam_from_world, noise_px, scales[view]);
    Rigid3d& pose = scene.views[view].cam_from_world;
    pose = CamFromWorld(ExpSO3(noise.rotation_stddev_rad * RandomVector(&random)) * pose.rotation,
                        CamInWorld(pose) + noise.position_stddev * RandomVector(&random));
  }
  SyntheticTracks exact = scene;
  AdjustBundle({}, &exact.views, &exact.tracks);
  double estimated_px = 0.1;
  for (int round = 0; round < 4; ++round) {
    for (size_t view = 1; view < scene.views.size(); ++view) {
      const Rigid3d given = round == 0 ? scene.views[view].cam_from_world : scene.views[view].prior->cam_from_world;
      scene.views[view].prior = MakePosePrior(given, estimated_px, scales[view]);
    }
    const BundleAdjustmentResult result = AdjustBundle({}, &scene.views, &scene.tracks);
    estimated_px = EstimateDatabasePoseNoise(scene.views, scales, result.pose_covariances,
                                             VarianceFactor(scene.views, scene.tracks, 2), 0.1);
  }
  return {PositionError(exact.views[0].cam_from_world, truth), PositionError(scene.views[0].cam_from_world, truth),
          estimated_px};
}

TEST(DatabasePoseNoise, IsFoundAndLowersTheError) {
  double exact_sum = 0, soft_sum = 0, estimated_sum = 0;
  constexpr int kNumTrials = 10;
  for (uint32_t seed = 0; seed < kNumTrials; ++seed) {
    const Trial trial = RunTrial(3, seed);
    exact_sum += trial.exact_error;
    soft_sum += trial.soft_error;
    estimated_sum += trial.estimated_px;
  }
  EXPECT_LE(soft_sum, 0.9 * exact_sum);
  EXPECT_GE(estimated_sum / kNumTrials, 1.5);
  EXPECT_LE(estimated_sum / kNumTrials, 4);
}

TEST(DatabasePoseNoise, ExactPosesAreFoundExact) {
  for (uint32_t seed = 0; seed < 5; ++seed) EXPECT_LE(RunTrial(0, seed).estimated_px, 0.1);
}

}  // namespace
}  // namespace lazyloc

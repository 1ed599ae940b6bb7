#include "colmap_lazyloc/refinement/covariance.h"

#include <cmath>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
constexpr double kWideScale = 1e6;  // plain least squares

BundleAdjustmentOptions LeastSquares() {
  BundleAdjustmentOptions options;
  options.loss_scale_sigma = kWideScale;
  return options;
}

TEST(PoseCovariance, PredictsTheSpreadOfAdjustedPoses) {
  // Sample covariance of 300 trials: each entry's relative error is about sqrt(2 / 300) = 8 %; four times that.
  SyntheticTracksOptions options;
  const SyntheticTracks truth = MakeSyntheticTracks(options);
  SyntheticTracks adjusted = truth;
  const Matrix6d predicted = AdjustBundle(LeastSquares(), &adjusted.views, &adjusted.tracks).pose_covariances[0];
  Matrix6d sampled = Matrix6d::Zero();
  const int num_trials = 300;
  Random random(3);
  for (int trial = 0; trial < num_trials; ++trial) {
    SyntheticTracks scene = truth;
    for (Track& track : scene.tracks) {
      for (TrackObservation& element : track.observations) {
        element.observation = ObserveAt(scene.views[element.view].cam_from_world * track.point_in_world,
                                        options.focal_length_px, RandomVector(&random).head<2>());
      }
    }
    ASSERT_TRUE(AdjustBundle(LeastSquares(), &scene.views, &scene.tracks).summary.success);
    const Rigid3d& pose = scene.views[0].cam_from_world;
    const Rigid3d& exact = truth.views[0].cam_from_world;
    Eigen::Matrix<double, 6, 1> error;
    error << LogSO3(pose.rotation * exact.rotation.conjugate()), pose.translation - exact.translation;
    sampled += error * error.transpose() / num_trials;
  }
  for (int i = 0; i < 6; ++i) EXPECT_NEAR(sampled(i, i) / predicted(i, i), 1, 0.33) << i;
}

TEST(PoseCovariance, OneFixedViewLeavesScaleOpen) {
  SyntheticTracksOptions options;
  options.num_database = 1;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  const BundleAdjustmentResult result = AdjustBundle(LeastSquares(), &scene.views, &scene.tracks);
  const Rigid3d& pose = scene.views[0].cam_from_world;
  const PoseSpread spread = ComputePoseSpread(pose, result.pose_covariances[0]);
  EXPECT_GE(spread.position_stddevs[0], 100);
  EXPECT_LE(spread.position_stddevs[1], 0.1);
  const Eigen::Vector3d baseline = CamInWorld(pose) - CamInWorld(scene.views[1].cam_from_world);
  EXPECT_LE(baseline.normalized().cross(spread.weakest_direction_in_world).norm(), 1e-3);
}

TEST(PoseSpread, IsThatOfSampledPoses) {
  // Sampled from the covariance itself: each variance is known to sqrt(2 / 20000) = 1 %.
  Random random(1);
  const Rigid3d pose = LookAt({1, 2, -8}, {0, 0, 0});
  Matrix6d root;
  for (int i = 0; i < 6; ++i)
    root.row(i) << 1e-3 * RandomVector(&random).transpose(), 1e-3 * RandomVector(&random).transpose();
  const PoseSpread spread = ComputePoseSpread(pose, root * root.transpose());
  Eigen::Matrix3d sampled = Eigen::Matrix3d::Zero();
  const int num_trials = 20000;
  for (int trial = 0; trial < num_trials; ++trial) {
    Eigen::Matrix<double, 6, 1> normal;
    normal << RandomVector(&random), RandomVector(&random);
    const Eigen::Matrix<double, 6, 1> move = root * normal;
    const Rigid3d moved{ExpSO3(move.head<3>()) * pose.rotation, pose.translation + move.tail<3>()};
    const Eigen::Vector3d offset = CamInWorld(moved) - CamInWorld(pose);
    sampled += offset * offset.transpose() / num_trials;
  }
  const Eigen::Vector3d& axis = spread.weakest_direction_in_world;
  EXPECT_NEAR(std::sqrt(axis.dot(sampled * axis)) / spread.position_stddevs[0], 1, 0.03);
  EXPECT_NEAR(std::sqrt(sampled.trace()) / spread.position_stddevs.norm(), 1, 0.03);
  EXPECT_LE((sampled * axis - axis.dot(sampled * axis) * axis).norm(), 0.05 * sampled.norm());
  EXPECT_GE(spread.position_stddevs[1], spread.position_stddevs[2]);
}

TEST(MedianDistance, IsFromTheView) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  for (Track& track : scene.tracks)
    track.point_in_world = CamInWorld(scene.views[2].cam_from_world) + Eigen::Vector3d(0, 3, 4);
  EXPECT_NEAR(MedianDistance(scene.views[2], scene.tracks), 5, 1e-12);
}

TEST(VarianceFactor, FindsTheNoise) {
  SyntheticTracksOptions options;
  options.num_points = 500;
  options.noise_px = 2;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  ASSERT_TRUE(AdjustBundle(LeastSquares(), &scene.views, &scene.tracks).summary.success);
  EXPECT_NEAR(VarianceFactor(scene.views, scene.tracks, kWideScale), 4, 0.3);
  for (View& view : scene.views) view.noise_px = 2;
  EXPECT_NEAR(VarianceFactor(scene.views, scene.tracks, kWideScale), 1, 0.08);
}

}  // namespace
}  // namespace lazyloc

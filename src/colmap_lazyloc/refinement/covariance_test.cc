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
  EXPECT_GE(RelativePoseStddev(result.pose_covariances[0], 8), 10);
}

TEST(RelativePoseStddev, CountsTranslationInUnitsOfTheDistance) {
  Matrix6d covariance = 1e-6 * Matrix6d::Identity();
  EXPECT_NEAR(RelativePoseStddev(covariance, 1), 1e-3, 1e-12);
  EXPECT_NEAR(RelativePoseStddev(covariance, 0.1), 1e-2, 1e-12);
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

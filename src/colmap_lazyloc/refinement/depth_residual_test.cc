#include "colmap_lazyloc/refinement/depth_residual.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/refinement/bundle_problem.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/scene/pose_distribution.h"
#include "colmap_lazyloc/testing/jacobian_check.h"
#include "colmap_lazyloc/testing/pose_expectations.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

constexpr double kScaleStddev = 0.03;

TEST(DepthError, Derivatives) {
  const Eigen::Vector3d point(0.3, -0.2, 0.5);
  const DepthObservation depth{0, Eigen::Vector3d(0.1, 0.2, 1).normalized(), 0.3, std::log(4.0), 20};
  ParameterBlock frame;
  frame.MoveTo({ExpSO3(Eigen::Vector3d(0.2, 0.5, -0.3)), Eigen::Vector3d(0.1, -0.4, 5)});
  DepthError error;
  ASSERT_TRUE(error.Evaluate(depth, &frame, 0.1, point));
  Eigen::Matrix<double, 1, 10> jacobian;
  jacobian << error.by_frame.transpose(), error.by_point_in_world.transpose(), error.by_log_scale;
  ExpectJacobian(
      [&](const Eigen::VectorXd& step) {
        ParameterBlock moved;
        const Rigid3d& pose = frame.frame_from_world;
        moved.MoveTo({ExpSO3(step.head<3>()) * pose.rotation, pose.translation + step.segment<3>(3)});
        DepthError at;
        EXPECT_TRUE(at.Evaluate(depth, &moved, 0.1 + step[9], point + step.segment<3>(6)));
        return Eigen::VectorXd::Constant(1, at.error);
      },
      jacobian);
}

TEST(DepthError, PointsBehindTheImageHaveNone) {
  const DepthObservation depth{-1, Eigen::Vector3d::UnitZ(), 0, 0, 1};
  DepthError error;
  EXPECT_TRUE(error.Evaluate(depth, nullptr, 0, {0, 0, 1}));
  EXPECT_FALSE(error.Evaluate(depth, nullptr, 0, {0, 0, -1}));
}

// Returns a query and one database image with a depth map whose scale is known up to kScaleStddev.
SyntheticTracks MakeScene(double noise_px, uint32_t seed = 0) {
  SyntheticTracksOptions options;
  options.num_database = 1;
  options.noise_px = noise_px;
  options.seed = seed;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  scene.posed.images[1].depth_scale = {0, 0, kScaleStddev, 0.01};
  for (Track& track : scene.tracks) {
    track.observations.back().depth = static_cast<float>((CamFromWorld(scene.posed, 1) * track.point_in_world).z());
  }
  return scene;
}

double BaselineLength(const PosedImages& posed) {
  return (CamInWorld(CamFromWorld(posed, 0)) - CamInWorld(CamFromWorld(posed, 1))).norm();
}

TEST(DepthsInAdjustment, DepthsOfOneImageTellTheDistance) {
  const SyntheticTracks truth = MakeScene(0);
  SyntheticTracks scene = truth;
  DisturbQueries(&scene, 1, 0.1, 0.05);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  EXPECT_LE(PositionError(CamFromWorld(result.posed, 0), CamFromWorld(truth.posed, 0)), 1e-5);
  EXPECT_NEAR(result.posed.images[1].depth_scale->log_scale, 0, 1e-5);
}

TEST(DepthsInAdjustment, ErrorOfAMapsScaleIsCommonToAllItsPoints) {
  const SyntheticTracks scene = MakeScene(0);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  const Eigen::Matrix3d covariance =
      MakePoseDistribution(result.posed.frames[0].frame_from_world, result.frame_covariances[0]).PositionCovariance();
  const Eigen::Vector3d baseline =
      CamInWorld(CamFromWorld(result.posed, 0)) - CamInWorld(CamFromWorld(result.posed, 1));
  const Eigen::Vector3d along = baseline.normalized();
  const double stddev_along = std::sqrt(along.dot(covariance * along)) / baseline.norm();
  EXPECT_GE(stddev_along, kScaleStddev);
  EXPECT_LE(stddev_along, 1.1 * kScaleStddev);
}

TEST(DepthsInAdjustment, TracksWithMoreNoiseThanOthersHaveLessCertainDepths) {
  SyntheticTracks scene = MakeScene(0);
  scene.tracks[1].noise_ratio = 3;
  const BundleProblem mixed(scene.posed, scene.tracks);
  ASSERT_EQ(mixed.depths.size(), scene.tracks.size());
  EXPECT_DOUBLE_EQ(mixed.depths[0].residual_from_log, 100);
  EXPECT_DOUBLE_EQ(mixed.depths[1].residual_from_log, 100. / 3);
  for (Track& track : scene.tracks) track.noise_ratio = 3;
  const BundleProblem alike(scene.posed, scene.tracks);
  for (const DepthObservation& depth : alike.depths) EXPECT_DOUBLE_EQ(depth.residual_from_log, 100);
}

TEST(DepthsInAdjustment, AMapsScaleFollowsItsPrior) {
  SyntheticTracks scene = MakeScene(0);
  const double before = BaselineLength(scene.posed);
  scene.posed.images[1].depth_scale->stated_log_scale = std::log(1.1);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  EXPECT_NEAR(BaselineLength(result.posed) / before, 1.1, 1e-3);
  EXPECT_NEAR(result.posed.images[1].depth_scale->log_scale, std::log(1.1), 1e-3);
}

TEST(DepthsInAdjustment, MovingDatabaseImagesGiveTheSameAsConstantOnes) {
  SyntheticTracks scene = MakeScene(0.5);
  const BundleAdjustmentResult constant = AdjustBundle(scene.posed, scene.tracks, {});
  Frame& frame = scene.posed.frames[1];
  frame.prior = PosePrior{frame.frame_from_world, 1e-7, 1e-7};
  const BundleAdjustmentResult moving = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(constant.summary.success && moving.summary.success);
  EXPECT_LE(PositionError(CamFromWorld(moving.posed, 0), CamFromWorld(constant.posed, 0)), 1e-4);
  EXPECT_LE((moving.frame_covariances[0] - constant.frame_covariances[0]).norm(),
            1e-3 * constant.frame_covariances[0].norm());
}

}  // namespace
}  // namespace lazyloc

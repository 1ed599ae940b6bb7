#include "colmap_lazyloc/ablation/sampson_refinement.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/ablation/sampson_error.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

// Exact poses of the free views, disturbed.
std::vector<View> Start(const SyntheticTracks& scene, double rotation_deg, double distance) {
  Random random(17);
  std::vector<View> views = scene.views;
  for (View& view : views) {
    if (view.is_database) continue;
    view.cam_from_world.rotation = Disturbed(view.cam_from_world.rotation, rotation_deg, &random);
    view.cam_from_world.translation += distance * RandomVector(&random).normalized();
  }
  return views;
}

SyntheticTracks MakeScene(int num_query, double noise_px, uint32_t seed) {
  SyntheticTracksOptions options;
  options.num_query = num_query;
  options.noise_px = noise_px;
  options.seed = seed;
  return MakeSyntheticTracks(options);
}

SampsonRefinementOptions Precise() {
  SampsonRefinementOptions options;
  options.function_tolerance = 0;
  return options;
}

class SampsonContract : public testing::TestWithParam<int> {};

TEST_P(SampsonContract, NoiseFreeIsExact) {
  const SyntheticTracks scene = MakeScene(GetParam(), 0, 1);
  std::vector<View> views = Start(scene, 1, 0.2);
  const StageSummary summary = RefineBySampsonError(Precise(), scene.tracks, &views);
  ASSERT_TRUE(summary.success) << summary.message;
  for (int query = 0; query < GetParam(); ++query) {
    EXPECT_LE(PositionError(views[query].cam_from_world, scene.views[query].cam_from_world), 8 * 1e-8);
    EXPECT_LE(RotationErrorDeg(views[query].cam_from_world, scene.views[query].cam_from_world), RadToDeg(1e-8));
  }
}

TEST_P(SampsonContract, KeepsFixedPosesBitwise) {
  const SyntheticTracks scene = MakeScene(GetParam(), 1, 2);
  std::vector<View> views = Start(scene, 1, 0.2);
  ASSERT_TRUE(RefineBySampsonError({}, scene.tracks, &views).success);
  for (size_t view = GetParam(); view < views.size(); ++view) {
    EXPECT_EQ(views[view].cam_from_world.rotation.coeffs(), scene.views[view].cam_from_world.rotation.coeffs());
    EXPECT_EQ(views[view].cam_from_world.translation, scene.views[view].cam_from_world.translation);
  }
}

TEST_P(SampsonContract, TrackOrderDoesNotMatter) {
  SyntheticTracks scene = MakeScene(GetParam(), 1, 3);
  std::vector<View> straight = Start(scene, 1, 0.2), reversed = straight;
  RefineBySampsonError(Precise(), scene.tracks, &straight);
  std::reverse(scene.tracks.begin(), scene.tracks.end());
  RefineBySampsonError(Precise(), scene.tracks, &reversed);
  for (int query = 0; query < GetParam(); ++query) {
    EXPECT_LE(PositionError(straight[query].cam_from_world, reversed[query].cam_from_world), 8 * 1e-8);
  }
}

INSTANTIATE_TEST_SUITE_P(SampsonRefinement, SampsonContract, testing::Values(1, 3));

TEST(SampsonError, JacobianIsThatOfFiniteDifferences) {
  const SyntheticTracks scene = MakeScene(1, 2, 4);
  const View query = Start(scene, 1, 0.3)[0];
  const Eigen::Quaterniond rotation = query.cam_from_world.rotation;
  const Eigen::Vector3d centre = CamInWorld(query.cam_from_world);
  for (int i = 0; i < 10; ++i) {
    const std::vector<TrackObservation>& observations = scene.tracks[i].observations;
    const EpipolarMatch match = MakeEpipolarMatch(scene.views[observations[2].view], observations[2].observation, query,
                                                  observations[0].observation, /*noise_ratio=*/1);
    Eigen::Matrix<double, 1, 6> jacobian, ignored;
    SampsonError(match, rotation.toRotationMatrix(), centre, &jacobian);
    const auto error_at = [&](const Eigen::Matrix<double, 6, 1>& step) {
      return SampsonError(match, (ExpSO3(step.head<3>()) * rotation).toRotationMatrix(), centre + step.tail<3>(),
                          &ignored);
    };
    for (int column = 0; column < 6; ++column) {
      const Eigen::Matrix<double, 6, 1> step = 1e-5 * Eigen::Matrix<double, 6, 1>::Unit(column);
      const double difference = (error_at(step) - error_at(-step)) / 2e-5;
      EXPECT_NEAR(jacobian(column), difference, 1e-6 * jacobian.norm());
    }
  }
}

// Of image points with the stated noise, at the true pose, the error is standard normal.
TEST(SampsonError, CountsStandardDeviations) {
  SyntheticTracks scene = MakeScene(1, 0.5, 5);
  for (View& view : scene.views) view.noise_px = 0.5;
  const Rigid3d& pose = scene.views[0].cam_from_world;
  double sum = 0;
  Eigen::Matrix<double, 1, 6> jacobian;
  for (const Track& track : scene.tracks) {
    const EpipolarMatch match = MakeEpipolarMatch(scene.views[1], track.observations[1].observation, scene.views[0],
                                                  track.observations[0].observation, /*noise_ratio=*/1);
    sum += std::pow(SampsonError(match, pose.rotation.toRotationMatrix(), CamInWorld(pose), &jacobian), 2);
  }
  const double num_matches = static_cast<double>(scene.tracks.size());
  EXPECT_NEAR(sum / num_matches, 1, 4 * std::sqrt(2 / num_matches));
}

TEST(SampsonError, WithoutBaselineIsZero) {
  const SyntheticTracks scene = MakeScene(1, 0, 6);
  const auto& observations = scene.tracks[0].observations;
  const EpipolarMatch match = MakeEpipolarMatch(scene.views[1], observations[1].observation, scene.views[0],
                                                observations[0].observation, /*noise_ratio=*/1);
  Eigen::Matrix<double, 1, 6> jacobian;
  EXPECT_EQ(SampsonError(match, Eigen::Matrix3d::Identity(), match.fixed_in_world, &jacobian), 0);
  EXPECT_TRUE(jacobian.isZero());
}

// A tenth of the query's image points is moved by 200 px: Cauchy's loss forgets them, up to three times the error of
// about 0.015 units that the noise makes.
TEST(SampsonRefinement, WithstandsOutliers) {
  for (uint32_t seed = 0; seed < 10; ++seed) {
    SyntheticTracks scene = MakeScene(1, 0.5, seed);
    const std::vector<Track> good(scene.tracks.begin() + 6, scene.tracks.end());
    for (int i = 0; i < 6; ++i) {
      const Eigen::Vector3d point_in_cam = scene.views[0].cam_from_world * scene.tracks[i].point_in_world;
      scene.tracks[i].observations[0].observation = ObserveAt(point_in_cam, 500, {200, -100});
    }
    for (View& view : scene.views) view.noise_px = 0.5;
    std::vector<View> with = Start(scene, 0.5, 0.1), without = with;
    ASSERT_TRUE(RefineBySampsonError({}, scene.tracks, &with).success);
    ASSERT_TRUE(RefineBySampsonError({}, good, &without).success);
    EXPECT_LE(PositionError(with[0].cam_from_world, without[0].cam_from_world), 0.045) << "seed " << seed;
  }
}

// All cameras on one line: every epipolar line goes through the same epipoles, wherever on the line the query stands.
// Points that two fixed views triangulate tell.
TEST(SampsonRefinement, IsBlindAlongTheLineOfAllCamerasWhereTracksAreNot) {
  SyntheticTracks scene = MakeScene(1, 0, 8);
  for (size_t view = 0; view < scene.views.size(); ++view) {
    const double x = view == 0 ? 0.7 : static_cast<double>(view) - 3;
    scene.views[view].cam_from_world = LookAt({x, 0, -8}, {0.1 * x, 0, 0});
  }
  for (Track& track : scene.tracks) {
    for (TrackObservation& element : track.observations) {
      element.observation = ObserveAt(scene.views[element.view].cam_from_world * track.point_in_world, 500, {0, 0});
    }
  }
  const Rigid3d truth = scene.views[0].cam_from_world;
  std::vector<View> by_sampson = scene.views;
  by_sampson[0].cam_from_world = CamFromWorld(truth.rotation, CamInWorld(truth) + Eigen::Vector3d(0.3, 0, 0));
  std::vector<View> by_tracks = by_sampson;
  ASSERT_TRUE(RefineBySampsonError(Precise(), scene.tracks, &by_sampson).success);
  ASSERT_TRUE(AdjustBundle({}, &by_tracks, &scene.tracks).summary.success);
  EXPECT_NEAR(PositionError(by_sampson[0].cam_from_world, truth), 0.3, 1e-3);
  EXPECT_LE(PositionError(by_tracks[0].cam_from_world, truth), 1e-3);
}

TEST(SampsonRefinement, DegenerateInputFailsAndChangesNothing) {
  SyntheticTracks scene = MakeScene(1, 0, 7);
  const std::vector<View> start = Start(scene, 1, 0.2);
  std::vector<View> views = start;
  EXPECT_FALSE(RefineBySampsonError({}, {}, &views).success);
  scene.tracks[0].observations[0].observation.ray_in_cam.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(RefineBySampsonError({}, scene.tracks, &views).success);
  EXPECT_EQ(views[0].cam_from_world.translation, start[0].cam_from_world.translation);
  EXPECT_EQ(views[0].cam_from_world.rotation.coeffs(), start[0].cam_from_world.rotation.coeffs());
}

// One fixed view: the distance to it is open and stays near the start's.
TEST(SampsonRefinement, OneFixedViewGivesABearing) {
  SyntheticTracksOptions options;
  options.num_database = 1;
  const SyntheticTracks scene = MakeSyntheticTracks(options);
  std::vector<View> views = Start(scene, 1, 0.2);
  ASSERT_TRUE(RefineBySampsonError(Precise(), scene.tracks, &views).success);
  const Eigen::Vector3d fixed = CamInWorld(scene.views[1].cam_from_world);
  EXPECT_LE(
      AngleBetweenRad(CamInWorld(views[0].cam_from_world) - fixed, CamInWorld(scene.views[0].cam_from_world) - fixed),
      1e-6);
}

TEST(SampsonRefinementOptions, NamesTheInvalidField) {
  SampsonRefinementOptions options;
  std::string error;
  EXPECT_TRUE(options.Check(&error));
  options.max_num_iterations = 0;
  EXPECT_FALSE(options.Check(&error));
  EXPECT_THAT(error, testing::HasSubstr("max_num_iterations"));
}

}  // namespace
}  // namespace lazyloc

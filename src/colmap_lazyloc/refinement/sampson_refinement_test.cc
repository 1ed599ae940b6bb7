#include "colmap_lazyloc/refinement/sampson_refinement.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/testing/jacobian_check.h"
#include "colmap_lazyloc/testing/pose_expectations.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

// Returns the scene's images with disturbed poses of the queries.
PosedImages Start(const SyntheticTracks& scene, double rotation_deg, double distance) {
  Random random(17);
  PosedImages posed = scene.posed;
  for (Frame& frame : posed.frames) {
    if (frame.is_database) continue;
    frame.frame_from_world.rotation = Disturbed(frame.frame_from_world.rotation, rotation_deg, &random);
    frame.frame_from_world.translation += distance * RandomVector(&random).normalized();
  }
  return posed;
}

SyntheticTracks MakeScene(int num_query, double noise_px, uint32_t seed) {
  SyntheticTracksOptions options;
  options.num_query = num_query;
  options.noise_px = noise_px;
  options.seed = seed;
  return MakeSyntheticTracks(options);
}

class SampsonContract : public testing::TestWithParam<int> {};

TEST_P(SampsonContract, NoiseFreeIsExact) {
  const SyntheticTracks scene = MakeScene(GetParam(), 0, 1);
  const PoseRefinementResult result =
      RefineBySampsonError(Start(scene, 1, 0.2), scene.tracks, /*function_tolerance=*/0);
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  for (int query = 0; query < GetParam(); ++query) {
    const Rigid3d refined = CamFromWorld(result.posed, query), truth = CamFromWorld(scene.posed, query);
    EXPECT_LE(PositionError(refined, truth), 8 * 1e-8);
    EXPECT_LE(RotationErrorDeg(refined, truth), RadToDeg(1e-8));
  }
}

TEST_P(SampsonContract, KeepsDatabasePosesBitwise) {
  const SyntheticTracks scene = MakeScene(GetParam(), 1, 2);
  const PoseRefinementResult result = RefineBySampsonError(Start(scene, 1, 0.2), scene.tracks);
  ASSERT_TRUE(result.summary.success);
  for (size_t i = GetParam(); i < result.posed.frames.size(); ++i) {
    ExpectSameBits(result.posed.frames[i].frame_from_world, scene.posed.frames[i].frame_from_world);
  }
}

TEST_P(SampsonContract, TrackOrderDoesNotMatter) {
  SyntheticTracks scene = MakeScene(GetParam(), 1, 3);
  const PosedImages start = Start(scene, 1, 0.2);
  const PosedImages straight = RefineBySampsonError(start, scene.tracks, /*function_tolerance=*/0).posed;
  std::reverse(scene.tracks.begin(), scene.tracks.end());
  const PosedImages reversed = RefineBySampsonError(start, scene.tracks, /*function_tolerance=*/0).posed;
  for (int query = 0; query < GetParam(); ++query) {
    EXPECT_LE(PositionError(CamFromWorld(straight, query), CamFromWorld(reversed, query)), 8 * 1e-8);
  }
}

INSTANTIATE_TEST_SUITE_P(SampsonRefinement, SampsonContract, testing::Values(1, 3));

// Moves a tenth of the query's keypoints by 200 px. Cauchy's loss ignores them, up to three times the error of about
// 0.015 units that the noise makes.
TEST(SampsonRefinement, WithstandsOutliers) {
  for (uint32_t seed = 0; seed < 10; ++seed) {
    SyntheticTracks scene = MakeScene(1, 0.5, seed);
    const std::vector<Track> good(scene.tracks.begin() + 6, scene.tracks.end());
    for (int i = 0; i < 6; ++i) {
      const Eigen::Vector3d point_in_cam = CamFromWorld(scene.posed, 0) * scene.tracks[i].point_in_world;
      scene.tracks[i].observations[0].observation = ObserveAt(point_in_cam, 500, {200, -100});
    }
    for (Image& image : scene.posed.images) image.noise_px = 0.5;
    const PosedImages start = Start(scene, 0.5, 0.1);
    const PoseRefinementResult with = RefineBySampsonError(start, scene.tracks);
    const PoseRefinementResult without = RefineBySampsonError(start, good);
    ASSERT_TRUE(with.summary.success && without.summary.success);
    EXPECT_LE(PositionError(CamFromWorld(with.posed, 0), CamFromWorld(without.posed, 0)), 0.045) << "seed " << seed;
  }
}

// Puts all cameras on one line: every epipolar line goes through the same epipoles, wherever on the line the query is.
// Points that two database images triangulate fix its position.
TEST(SampsonRefinement, IsBlindAlongTheLineOfAllCamerasButTracksAreNot) {
  SyntheticTracks scene = MakeScene(1, 0, 8);
  for (size_t i = 0; i < scene.posed.frames.size(); ++i) {
    const double x = i == 0 ? 0.7 : static_cast<double>(i) - 3;
    scene.posed.frames[i].frame_from_world = LookAt({x, 0, -8}, {0.1 * x, 0, 0});
  }
  for (Track& track : scene.tracks) {
    for (TrackObservation& element : track.observations) {
      element.observation = ObserveAt(CamFromWorld(scene.posed, element.image) * track.point_in_world, 500, {0, 0});
    }
  }
  const Rigid3d truth = CamFromWorld(scene.posed, 0);
  PosedImages start = scene.posed;
  start.frames[0].frame_from_world = CamFromWorld(truth.rotation, CamInWorld(truth) + Eigen::Vector3d(0.3, 0, 0));
  const PoseRefinementResult by_sampson = RefineBySampsonError(start, scene.tracks, /*function_tolerance=*/0);
  const BundleAdjustmentResult by_tracks = AdjustBundle(start, scene.tracks, {});
  ASSERT_TRUE(by_sampson.summary.success && by_tracks.summary.success);
  EXPECT_NEAR(PositionError(CamFromWorld(by_sampson.posed, 0), truth), 0.3, 1e-3);
  EXPECT_LE(PositionError(CamFromWorld(by_tracks.posed, 0), truth), 1e-3);
}

TEST(SampsonRefinement, DegenerateInputFailsAndChangesNothing) {
  SyntheticTracks scene = MakeScene(1, 0, 7);
  const PosedImages start = Start(scene, 1, 0.2);
  const auto expect_failure = [&](const std::vector<Track>& tracks) {
    const PoseRefinementResult result = RefineBySampsonError(start, tracks);
    EXPECT_FALSE(result.summary.success);
    ExpectSameBits(CamFromWorld(result.posed, 0), CamFromWorld(start, 0));
  };
  expect_failure({});
  scene.tracks[0].observations[0].observation.ray_in_cam.x() = std::numeric_limits<double>::quiet_NaN();
  expect_failure(scene.tracks);
}

// Leaves one database image: the distance to it is unobservable and stays near the start's.
TEST(SampsonRefinement, OneDatabaseImageGivesABearing) {
  SyntheticTracksOptions options;
  options.num_database = 1;
  const SyntheticTracks scene = MakeSyntheticTracks(options);
  const PoseRefinementResult result =
      RefineBySampsonError(Start(scene, 1, 0.2), scene.tracks, /*function_tolerance=*/0);
  ASSERT_TRUE(result.summary.success);
  const Eigen::Vector3d database = CamInWorld(CamFromWorld(scene.posed, 1));
  EXPECT_LE(AngleBetweenRad(CamInWorld(CamFromWorld(result.posed, 0)) - database,
                            CamInWorld(CamFromWorld(scene.posed, 0)) - database),
            1e-6);
}

}  // namespace
}  // namespace lazyloc

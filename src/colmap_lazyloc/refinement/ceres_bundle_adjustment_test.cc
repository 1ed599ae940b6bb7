#include "colmap_lazyloc/refinement/ceres_bundle_adjustment.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/pose_expectations.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

// The costs and minima are compared in ceres_agreement_test.cc.
namespace lazyloc {
namespace {

SyntheticTracks MakeDisturbed(double noise_px, SyntheticTracks* truth) {
  SyntheticTracksOptions options;
  options.num_query = 2;
  options.noise_px = noise_px;
  options.min_images_ratio = 0.5;
  *truth = MakeSyntheticTracks(options);
  SyntheticTracks scene = *truth;
  DisturbQueries(&scene, 2, 0.2, 0.1);
  return scene;
}

TEST(AdjustWithCeres, NoiseFreeIsExactWithTheDefaults) {
  SyntheticTracks truth;
  const SyntheticTracks scene = MakeDisturbed(0, &truth);
  const CeresAdjustment result = AdjustWithCeres(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  for (int query = 0; query < 2; ++query) {
    EXPECT_LE(PositionError(CamFromWorld(result.posed, query), CamFromWorld(truth.posed, query)), 8 * 1e-7);
  }
  EXPECT_TRUE(result.image_covariances.empty());
}

TEST(AdjustWithCeres, KeepsDatabasePosesBitwise) {
  SyntheticTracks truth;
  SyntheticTracks scene = MakeDisturbed(1, &truth);
  scene.posed.frames.back().frame_from_world.rotation.coeffs() *= 1 + 1e-9;  // would not survive a normalisation
  const CeresAdjustment result = AdjustWithCeres(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  for (size_t i = 0; i < scene.posed.frames.size(); ++i) {
    if (!scene.posed.frames[i].is_database) continue;
    ExpectSameBits(result.posed.frames[i].frame_from_world, scene.posed.frames[i].frame_from_world);
  }
}

TEST(AdjustWithCeres, PointBehindACameraFailsAndChangesNoPose) {
  SyntheticTracks truth;
  SyntheticTracks scene = MakeDisturbed(1, &truth);
  const Rigid3d& pose = scene.posed.frames[0].frame_from_world;
  for (Track& track : scene.tracks) {
    if (track.observations.front().image != 0) continue;
    track.point_in_world = Inverse(pose) * Eigen::Vector3d(0, 0, -1);
    break;
  }
  const CeresAdjustment result = AdjustWithCeres(scene.posed, scene.tracks, {});
  EXPECT_FALSE(result.summary.success);
  ExpectSameBits(result.posed.frames[0].frame_from_world, pose);
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/refinement/view_noise.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

TEST(ViewNoise, FindsTheNoiseOfTheImagePoints) {
  SyntheticTracksOptions options;
  options.num_points = 500;
  options.noise_px = 1.5;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  ASSERT_TRUE(AdjustBundle({}, &scene.views, &scene.tracks).summary.success);
  EstimateViewNoise(scene.tracks, 0.1, &scene.views);
  // A view nearer to the points draws them to itself: its own errors look smaller, the others' larger.
  double sum = 0;
  for (const View& view : scene.views) {
    EXPECT_NEAR(view.noise_px, 1.5, 0.75);
    sum += view.noise_px;
  }
  EXPECT_NEAR(sum / static_cast<double>(scene.views.size()), 1.5, 0.25);
}

TEST(ViewNoise, SeesThatOneDatabasePoseIsOff) {
  SyntheticTracksOptions options;
  options.num_points = 500;
  options.noise_px = 0.5;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  scene.views[3].cam_from_world.translation += Eigen::Vector3d(0.1, 0, 0);  // some 6 px
  ASSERT_TRUE(AdjustBundle({}, &scene.views, &scene.tracks).summary.success);
  EstimateViewNoise(scene.tracks, 0.1, &scene.views);
  for (size_t view = 0; view < scene.views.size(); ++view) {
    if (view == 3) {
      EXPECT_GE(scene.views[view].noise_px, 3);
    } else {
      EXPECT_LE(scene.views[view].noise_px, 1.5);
    }
  }
}

TEST(ViewNoise, KeepsToTheMinimum) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  EstimateViewNoise(scene.tracks, 0.25, &scene.views);
  for (const View& view : scene.views) EXPECT_EQ(view.noise_px, 0.25);
}

TEST(ViewNoise, WithoutTracksNothingChanges) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  scene.views[0].noise_px = 7;
  EstimateViewNoise({}, 0.25, &scene.views);
  EXPECT_EQ(scene.views[0].noise_px, 7);
}

}  // namespace
}  // namespace lazyloc

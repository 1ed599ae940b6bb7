#include "colmap_lazyloc/refinement/view_noise.h"

#include <utility>

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

// Tracks of noise_px = 1, and as many that only the query and a database image see, of another noise.
double SpreadOf(double single_view_noise_px) {
  SyntheticTracksOptions options;
  options.num_points = 600;
  options.noise_px = 1;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  options.noise_px = single_view_noise_px;
  for (Track& track : MakeSyntheticTracks(options).tracks) {
    track.observations.resize(2);
    scene.tracks.push_back(std::move(track));
  }
  for (View& view : scene.views) view.noise_px = 1;
  EXPECT_TRUE(AdjustBundle({}, &scene.views, &scene.tracks).summary.success);
  return MeasureSingleViewSpread(scene.tracks, scene.views);
}

TEST(SingleViewSpread, IsTheRatioOfVariances) {
  EXPECT_NEAR(SpreadOf(1), 1, 0.25);
  EXPECT_NEAR(SpreadOf(2), 4, 1);
  EXPECT_EQ(SpreadOf(0.5), 1) << "better matches are not believed more";
}

TEST(SingleViewSpread, IsOneWithoutTracksToCompare) {
  const SyntheticTracks scene = MakeSyntheticTracks({});
  EXPECT_EQ(MeasureSingleViewSpread({}, scene.views), 1);
  EXPECT_EQ(MeasureSingleViewSpread(scene.tracks, scene.views), 1);
}

}  // namespace
}  // namespace lazyloc

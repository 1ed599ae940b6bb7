#include "colmap_lazyloc/noise/image_noise.h"

#include <utility>

#include <gtest/gtest.h>

#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

TEST(ImageNoise, FindsTheNoiseOfTheKeypoints) {
  SyntheticTracksOptions options;
  options.num_points = 500;
  options.noise_px = 1.5;
  const SyntheticTracks scene = MakeSyntheticTracks(options);
  const BundleAdjustmentResult adjusted = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(adjusted.summary.success);
  const std::vector<double> noise_px = EstimateImageNoise(adjusted.posed, adjusted.tracks, 0.1);
  ASSERT_EQ(noise_px.size(), scene.posed.images.size());
  // Allows for an image near the points, which attracts them: its own errors look smaller, the others' larger.
  double sum = 0;
  for (const double image_noise_px : noise_px) {
    EXPECT_NEAR(image_noise_px, 1.5, 0.75);
    sum += image_noise_px;
  }
  EXPECT_NEAR(sum / static_cast<double>(noise_px.size()), 1.5, 0.25);
}

TEST(ImageNoise, DetectsThatOneDatabasePoseIsOff) {
  SyntheticTracksOptions options;
  options.num_points = 500;
  options.noise_px = 0.5;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  scene.posed.frames[3].frame_from_world.translation += Eigen::Vector3d(0.1, 0, 0);  // about 6 px
  const BundleAdjustmentResult adjusted = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(adjusted.summary.success);
  const std::vector<double> noise_px = EstimateImageNoise(adjusted.posed, adjusted.tracks, 0.1);
  ASSERT_EQ(noise_px.size(), scene.posed.images.size());
  for (size_t image = 0; image < noise_px.size(); ++image) {
    if (image == 3) {
      EXPECT_GE(noise_px[image], 3);
    } else {
      EXPECT_LE(noise_px[image], 1.5);
    }
  }
}

TEST(ImageNoise, IsAtLeastTheMinimum) {
  const SyntheticTracks scene = MakeSyntheticTracks({});
  for (const double noise_px : EstimateImageNoise(scene.posed, scene.tracks, 0.25)) EXPECT_EQ(noise_px, 0.25);
}

TEST(ImageNoise, WithoutTracksIsThePresentNoise) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  scene.posed.images[0].noise_px = 7;
  const std::vector<double> noise_px = EstimateImageNoise(scene.posed, {}, 0.25);
  ASSERT_EQ(noise_px.size(), scene.posed.images.size());
  EXPECT_EQ(noise_px[0], 7);
  EXPECT_EQ(noise_px[1], 1);
}

// Returns the noise ratio of tracks with noise_px = 1 and as many that only the query and a database image see, which
// have another noise. has_rig: the other tracks have two images of one database frame.
double NoiseRatioOf(double single_image_noise_px, bool has_rig = false) {
  SyntheticTracksOptions options;
  options.num_points = 600;
  options.noise_px = 1;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  options.noise_px = single_image_noise_px;
  for (Track& track : MakeSyntheticTracks(options).tracks) {
    track.observations.resize(has_rig ? 3 : 2);
    scene.tracks.push_back(std::move(track));
  }
  if (has_rig) JoinFrame(1, 2, &scene.posed);
  for (Image& image : scene.posed.images) image.noise_px = 1;
  const BundleAdjustmentResult adjusted = AdjustBundle(scene.posed, scene.tracks, {});
  EXPECT_TRUE(adjusted.summary.success);
  return MeasureSingleImageNoiseRatio(adjusted.posed, adjusted.tracks);
}

TEST(SingleImageSpread, IsTheRatioOfVariances) {
  EXPECT_NEAR(NoiseRatioOf(1), 1, 0.25);
  EXPECT_NEAR(NoiseRatioOf(2), 4, 1);
  EXPECT_EQ(NoiseRatioOf(0.5), 1) << "better matches do not get a larger weight";
}

TEST(SingleImageSpread, CountsTheImagesOfADatabaseFrameAsOne) { EXPECT_NEAR(NoiseRatioOf(2, /*has_rig=*/true), 4, 1); }

TEST(SingleImageSpread, IsOneWithoutTracksToCompare) {
  const SyntheticTracks scene = MakeSyntheticTracks({});
  EXPECT_EQ(MeasureSingleImageNoiseRatio(scene.posed, {}), 1);
  EXPECT_EQ(MeasureSingleImageNoiseRatio(scene.posed, scene.tracks), 1);
}

}  // namespace
}  // namespace lazyloc

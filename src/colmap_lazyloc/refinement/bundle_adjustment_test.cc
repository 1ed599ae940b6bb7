#include "colmap_lazyloc/refinement/bundle_adjustment.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/pose_expectations.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

// Estimates the focal lengths of all queries but the last of several. Rotates their rays towards the optical axis, as a
// focal length that is too long does, and sets the derivative by its log such that log_focal_factor undoes exactly
// this.
void DisturbFocalLengths(double log_focal_factor, int num_query, SyntheticTracks* scene) {
  const int num_estimated = std::max(1, num_query - 1);
  for (int query = 0; query < num_estimated; ++query) scene->posed.images[query].log_focal_factor = 0;
  for (Track& track : scene->tracks) {
    for (TrackObservation& element : track.observations) {
      if (element.image >= num_estimated) continue;
      Observation& observation = element.observation;
      const Eigen::Vector3d point_in_cam = CamFromWorld(scene->posed, element.image) * track.point_in_world;
      const Eigen::Vector2d noise_px = ReprojectionError(observation, point_in_cam);
      observation.ray_in_cam.head<2>() *= std::exp(-log_focal_factor);
      observation.ray_in_cam.normalize();
      observation.px_from_cam -= observation.px_from_cam * observation.ray_in_cam * observation.ray_in_cam.transpose();
      observation.px_from_log_focal = (noise_px - ReprojectionError(observation, point_in_cam)) / log_focal_factor;
    }
  }
}

class QueryCounts : public testing::TestWithParam<int> {
 protected:
  SyntheticTracks Make(double noise_px) const {
    SyntheticTracksOptions options;
    options.num_query = GetParam();
    options.noise_px = noise_px;
    options.min_images_ratio = 0.5;
    return MakeSyntheticTracks(options);
  }
};

TEST_P(QueryCounts, NoiseFreeIsExact) {
  const SyntheticTracks truth = Make(0);
  SyntheticTracks scene = truth;
  DisturbQueries(&scene, 2, 0.2, 0.1);
  BundleAdjustmentOptions options;
  options.convergence_sigma = 1e-6;  // by default, a part of a standard deviation may be left
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, options);
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  for (int query = 0; query < GetParam(); ++query) {
    const Rigid3d adjusted = CamFromWorld(result.posed, query), exact = CamFromWorld(truth.posed, query);
    EXPECT_LE(PositionError(adjusted, exact), 1e-8 * 8);
    EXPECT_LE(RotationErrorDeg(adjusted, exact), RadToDeg(1e-8));
  }
  ASSERT_EQ(result.tracks.size(), truth.tracks.size());
  for (size_t i = 0; i < truth.tracks.size(); ++i) {
    EXPECT_LE((result.tracks[i].point_in_world - truth.tracks[i].point_in_world).norm(), 1e-7);
  }
}

TEST_P(QueryCounts, FocalLengthIsFoundExactlyWithoutNoise) {
  SyntheticTracks scene = Make(0);
  DisturbFocalLengths(0.1, GetParam(), &scene);
  const SyntheticTracks truth = scene;
  DisturbQueries(&scene, 2, 0.2, 0.1);
  BundleAdjustmentOptions options;
  options.convergence_sigma = 1e-6;
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, options);
  ASSERT_TRUE(result.summary.success);
  for (int query = 0; query < GetParam(); ++query) {
    EXPECT_LE(PositionError(CamFromWorld(result.posed, query), CamFromWorld(truth.posed, query)), 1e-7);
    const std::optional<double>& log_focal_factor = result.posed.images[query].log_focal_factor;
    const bool is_estimated = query == 0 || query < GetParam() - 1;
    ASSERT_EQ(log_focal_factor.has_value(), is_estimated);
    EXPECT_NEAR(log_focal_factor.value_or(0), is_estimated ? 0.1 : 0, 1e-8);
  }
  // Starts at the factor of the input: the first step from the solution is the last.
  const BundleAdjustmentResult again = AdjustBundle(result.posed, result.tracks, {});
  EXPECT_EQ(again.summary.iterations, 0);
  EXPECT_NEAR(*again.posed.images[0].log_focal_factor, 0.1, 1e-8);
}

TEST_P(QueryCounts, UnknownFocalLengthEnlargesTheCovariance) {
  SyntheticTracks scene = Make(1.5);
  DisturbFocalLengths(0.1, GetParam(), &scene);
  DisturbQueries(&scene, 1, 0.1, 0.05);
  BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success);
  EXPECT_GT(std::abs(*result.posed.images[0].log_focal_factor - 0.1), 1e-5) << "the noise has no effect";
  for (Image& image : result.posed.images) image.log_focal_factor.reset();
  EXPECT_GT(result.image_covariances[0].trace(),
            AdjustBundle(result.posed, result.tracks, {}).image_covariances[0].trace());
}

TEST_P(QueryCounts, KeepsConstantFramesBitwise) {
  SyntheticTracks scene = Make(1);
  const PosedImages before = scene.posed;
  DisturbQueries(&scene, 1, 0.1, 0.1);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success);
  for (size_t i = 0; i < before.frames.size(); ++i) {
    if (!before.frames[i].is_database) continue;
    ExpectSameBits(result.posed.frames[i].frame_from_world, before.frames[i].frame_from_world);
    EXPECT_TRUE(result.frame_covariances[i].isZero(0));
    EXPECT_TRUE(result.image_covariances[i].isZero(0));
  }
}

INSTANTIATE_TEST_SUITE_P(BundleAdjustment, QueryCounts, testing::Values(1, 3));

TEST(BundleAdjustment, PointBehindACameraFailsAndChangesNothing) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  DisturbQueries(&scene, 1, 0.1, 0.1);
  scene.tracks[0].point_in_world = Eigen::Vector3d(0, 0, -1000);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  EXPECT_FALSE(result.summary.success);
  ExpectSameBits(CamFromWorld(result.posed, 0), CamFromWorld(scene.posed, 0));
  ASSERT_EQ(result.tracks.size(), scene.tracks.size());
  EXPECT_EQ(result.tracks[1].point_in_world, scene.tracks[1].point_in_world);
  EXPECT_TRUE(result.frame_covariances.empty());
  EXPECT_TRUE(result.image_covariances.empty());
}

}  // namespace
}  // namespace lazyloc

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/testing/pose_expectations.h"
#include "colmap_lazyloc/testing/sampled_covariance.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

// Moves a database frame away from its pose, and gives it a prior that allows for that.
void DisturbWithPrior(int frame, PosedImages* posed) {
  Random random(frame);
  Rigid3d& pose = posed->frames[frame].frame_from_world;
  const Eigen::Quaterniond rotation = Disturbed(pose.rotation, 0.5, &random);
  pose = CamFromWorld(rotation, CamInWorld(pose) + 0.05 * RandomVector(&random));
  posed->frames[frame].prior = PosePrior{pose, DegToRad(0.5), 0.05};
}

// Holds the two database images of a frame.
struct SharedFrame {
  int first, second;
};
class SharedDatabaseFrames : public testing::TestWithParam<SharedFrame> {
 protected:
  SyntheticTracks MakeTruth(double noise_px) const {
    SyntheticTracksOptions options;
    options.noise_px = noise_px;
    SyntheticTracks scene = MakeSyntheticTracks(options);
    JoinFrame(GetParam().first, GetParam().second, &scene.posed);
    return scene;
  }
};

TEST_P(SharedDatabaseFrames, MoveAsOneToTheTruth) {
  // Leaves two tracks to the second image: too few for a pose of its own.
  SyntheticTracks truth = MakeTruth(0);
  const int second = GetParam().second;
  for (size_t i = 2; i < truth.tracks.size(); ++i) {
    std::vector<TrackObservation>& observations = truth.tracks[i].observations;
    observations.erase(observations.begin() + second);
  }
  for (Image& image : truth.posed.images) image.noise_px = 1e-3;
  SyntheticTracks scene = truth;
  const int shared = scene.posed.images[second].frame;
  DisturbWithPrior(shared, &scene.posed);
  DisturbQueries(&scene, 1, 0.1, 0.05);
  scene.posed.prior_groups = {{{shared}, {{Eigen::MatrixXd::Identity(1, 1), 1}}}};
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  for (const int image : {0, GetParam().first, second}) {
    EXPECT_LE(PositionError(CamFromWorld(result.posed, image), CamFromWorld(truth.posed, image)), 1e-4) << image;
    EXPECT_LE(RotationErrorDeg(CamFromWorld(result.posed, image), CamFromWorld(truth.posed, image)), 1e-3) << image;
    ExpectSameBits(result.posed.images[image].cam_from_frame, scene.posed.images[image].cam_from_frame);
  }
  ASSERT_EQ(result.prior_fits.size(), 1u);
  EXPECT_EQ(result.prior_fits[0].deviations.rows(), 1) << "one prior for both images";
  EXPECT_EQ(result.image_covariances[GetParam().first], result.frame_covariances[shared]);
  EXPECT_EQ(result.image_covariances[second],
            ImageCovariance(result.posed.images[second], false, result.frame_covariances[shared]));
}

TEST_P(SharedDatabaseFrames, WithoutPriorAreConstantBitwise) {
  SyntheticTracks scene = MakeTruth(1);
  DisturbQueries(&scene, 1, 0.1, 0.05);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success);
  for (int image = 1; image < 7; ++image) {
    ExpectSameBits(CamFromWorld(result.posed, image), CamFromWorld(scene.posed, image));
    EXPECT_TRUE(result.image_covariances[image].isZero(0));
  }
}

// Moves the second image next to the first.
SyntheticTracks WithImagesTogether(SyntheticTracks scene, const SharedFrame& shared) {
  std::vector<Image>& images = scene.posed.images;
  const auto together = images.begin() + shared.first + 1, apart = images.begin() + shared.second;
  std::rotate(together, apart, apart + 1);
  for (Track& track : scene.tracks) {
    for (TrackObservation& element : track.observations) {
      if (element.image == shared.second) {
        element.image = shared.first + 1;
      } else if (shared.first < element.image && element.image < shared.second) {
        ++element.image;
      }
    }
    std::sort(track.observations.begin(), track.observations.end(),
              [](const TrackObservation& a, const TrackObservation& b) { return a.image < b.image; });
  }
  return scene;
}

TEST_P(SharedDatabaseFrames, NeedNotHaveTheirImagesTogether) {
  SyntheticTracks scene = MakeTruth(1.5);
  for (int frame = 1; frame < 6; ++frame) DisturbWithPrior(frame, &scene.posed);
  DisturbQueries(&scene, 1, 0.1, 0.05);
  const SyntheticTracks sorted = WithImagesTogether(scene, GetParam());
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  const BundleAdjustmentResult expected = AdjustBundle(sorted.posed, sorted.tracks, {});
  ASSERT_TRUE(result.summary.success && expected.summary.success);
  EXPECT_EQ(result.summary.iterations, expected.summary.iterations);
  for (int frame = 0; frame < 6; ++frame) {
    EXPECT_TRUE(result.frame_covariances[frame].isApprox(expected.frame_covariances[frame], 1e-6)) << frame;
    EXPECT_LE(PositionError(result.posed.frames[frame].frame_from_world, expected.posed.frames[frame].frame_from_world),
              1e-9);
  }
}

// Tries images of one frame that stand together, and images with others between them.
INSTANTIATE_TEST_SUITE_P(RigAdjustment, SharedDatabaseFrames,
                         testing::Values(SharedFrame{1, 2}, SharedFrame{1, 4}, SharedFrame{3, 6}));

// Makes two query frames of two images each. Estimates the scales of both, whose given offsets are too short by a
// factor.
SyntheticTracks MakeRigs(double noise_px, double factor) {
  SyntheticTracksOptions options;
  options.num_query = 4;
  options.noise_px = noise_px;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  JoinFrame(2, 3, &scene.posed);
  JoinFrame(0, 1, &scene.posed);
  for (const int query : {1, 3}) scene.posed.images[query].cam_from_frame.translation /= factor;
  for (const int frame : {0, 1}) scene.posed.frames[frame].has_free_scale = true;
  return scene;
}

TEST(RigAdjustment, FreeScaleIsFoundExactlyWithoutNoise) {
  const SyntheticTracks truth = MakeRigs(0, 1);
  SyntheticTracks scene = MakeRigs(0, 1.25);
  scene.posed.frames[1].scale = 2;
  DisturbQueries(&scene, 1, 0.1, 0.05);
  BundleAdjustmentOptions options;
  options.convergence_sigma = 1e-6;
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, options);
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  EXPECT_NEAR(result.posed.frames[0].scale, 1.25, 1e-8);
  EXPECT_NEAR(result.posed.frames[1].scale, 2 * 1.25, 1e-8) << "multiplies the estimate so far";
  for (int query = 0; query < 4; ++query) {
    EXPECT_LE(PositionError(CamFromWorld(result.posed, query), CamFromWorld(truth.posed, query)), 1e-7);
    const Rigid3d& cam_from_frame = result.posed.images[query].cam_from_frame;
    EXPECT_LE((cam_from_frame.translation - truth.posed.images[query].cam_from_frame.translation).norm(), 1e-7);
    EXPECT_EQ(cam_from_frame.rotation.coeffs(), scene.posed.images[query].cam_from_frame.rotation.coeffs());
  }
}

// The calibrations have the given offsets, so that they are right up to the scale.
TEST(RigAdjustment, FreeScaleIsFoundBesideCalibrationsWithAPrior) {
  const SyntheticTracks truth = MakeRigs(0, 1);
  SyntheticTracks scene = MakeRigs(0, 1.25);
  for (const int query : {1, 3}) {
    Image& image = scene.posed.images[query];
    image.calibration = static_cast<int>(scene.posed.calibrations.size());
    const Rigid3d& given = image.cam_from_frame;
    scene.posed.calibrations.push_back({given, PosePrior{given, 1e-3, 0.01}, 1e-4, 1e-3, false});
  }
  DisturbQueries(&scene, 1, 0.1, 0.05);
  BundleAdjustmentOptions options;
  options.convergence_sigma = 1e-6;
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, options);
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  for (const int frame : {0, 1}) EXPECT_NEAR(result.posed.frames[frame].scale, 1.25, 1e-6);
  for (int query = 0; query < 4; ++query) {
    EXPECT_LE(PositionError(CamFromWorld(result.posed, query), CamFromWorld(truth.posed, query)), 1e-6);
  }
  for (const int query : {1, 3}) {
    const Rigid3d& calibrated = result.posed.calibrations[scene.posed.images[query].calibration].cam_from_frame;
    const Rigid3d& right = truth.posed.images[query].cam_from_frame;
    EXPECT_LE((calibrated.translation - right.translation).norm(), 1e-6) << "with the scale";
    EXPECT_LE(RotationErrorDeg(calibrated, right), 1e-5);
  }
}

TEST(RigAdjustment, UnknownScaleEnlargesTheCovariance) {
  SyntheticTracks scene = MakeRigs(1.5, 1.25);
  DisturbWithPrior(3, &scene.posed);
  DisturbQueries(&scene, 1, 0.1, 0.05);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success);
  PosedImages known = result.posed;
  for (Frame& frame : known.frames) frame.has_free_scale = false;
  EXPECT_GT(result.image_covariances[1].trace(), AdjustBundle(known, result.tracks, {}).image_covariances[1].trace());
}

TEST(RigAdjustment, CovariancesPredictTheSpreadOfAdjustedRigs) {
  // Allows four times the relative error of a sample variance of 300 trials, sqrt(2 / 300) = 8 %.
  SyntheticTracks truth = MakeRigs(0, 1);
  truth.posed.frames[0].has_free_scale = false;
  // Leaves one database image to each track, so that its point depends on the queries.
  for (Track& track : truth.tracks) track.observations.resize(5);
  BundleAdjustmentOptions least_squares;
  least_squares.loss_scale_sigma = 1e6;
  const auto predicted = AdjustBundle(truth.posed, truth.tracks, least_squares).image_covariances;
  const auto sampled = SampleCovariances(truth, SyntheticTracksOptions().focal_length_px, least_squares, 300);
  for (int image = 0; image < 4; ++image) {
    for (int i = 0; i < 6; ++i) {
      EXPECT_NEAR(sampled[image](i, i) / predicted[image](i, i), 1, 0.33) << "image " << image << ", parameter " << i;
    }
  }
}

TEST(RigAdjustment, KnownRigOffsetsStayBitwise) {
  SyntheticTracks scene = MakeRigs(1, 1);
  scene.posed.frames[0].has_free_scale = false;
  DisturbQueries(&scene, 1, 0.1, 0.05);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success);
  ExpectSameBits(result.posed.images[1].cam_from_frame, scene.posed.images[1].cam_from_frame);
  EXPECT_EQ(result.posed.frames[0].scale, 1);
  EXPECT_NE(result.posed.frames[1].scale, 1);
}

TEST(RigAdjustment, RejectsFactorsThatAFrameHasNoParameterFor) {
  const SyntheticTracks rigs = MakeRigs(0, 1);
  const auto adjust_with_factors = [&](const std::vector<int>& images, bool has_free_scale) {
    PosedImages posed = rigs.posed;
    posed.frames[0].has_free_scale = has_free_scale;
    for (const int image : images) posed.images[image].log_focal_factor = 0;
    AdjustBundle(posed, rigs.tracks, {});
  };
  EXPECT_NO_THROW(adjust_with_factors({0}, false));
  EXPECT_THROW(adjust_with_factors({0}, true), std::logic_error) << "focal length and scale";
  EXPECT_THROW(adjust_with_factors({0, 1}, false), std::logic_error) << "two focal lengths";
  EXPECT_THROW(adjust_with_factors({4}, false), std::logic_error) << "a constant frame";
}

}  // namespace
}  // namespace lazyloc

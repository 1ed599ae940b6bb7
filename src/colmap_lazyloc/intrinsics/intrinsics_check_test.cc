#include "colmap_lazyloc/intrinsics/intrinsics_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/pipeline/lazy_localizer.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

using ::testing::HasSubstr;

SyntheticScene MakeScene(double factor, IntrinsicsOrigin origin) {
  SyntheticSceneOptions options;
  options.pixel_noise_px = 0.5;
  options.num_database_images = 15;
  SyntheticScene scene = MakeSyntheticScene(options);
  scene.problem.query_camera = WithFocalFactor(scene.problem.query_camera, factor);
  scene.problem.intrinsics_origin = origin;
  return scene;
}

LocalizationResult Localize(const SyntheticScene& scene, IntrinsicsMode mode = IntrinsicsMode::AUTO) {
  LocalizerOptions options;
  options.intrinsics = mode;
  return LocalizeQuery(scene.problem, options);
}

TEST(CheckIntrinsics, RightValueOfAWholeCameraIsConfirmed) {
  for (const IntrinsicsOrigin origin : {IntrinsicsOrigin::GIVEN, IntrinsicsOrigin::SHARED}) {
    const LocalizationResult result = Localize(MakeScene(1, origin));
    EXPECT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
    EXPECT_EQ(result.intrinsics.verdict, IntrinsicsVerdict::CONFIRMED);
    EXPECT_NEAR(result.intrinsics.focal_factor, 1, 5 * result.intrinsics.focal_factor_stddev);
    EXPECT_FALSE(result.is_camera_refined);
  }
}

class WrongFactors : public testing::TestWithParam<double> {};

TEST_P(WrongFactors, GivenValueIsRefusedAndTheRightOneNamed) {
  const LocalizationResult result = Localize(MakeScene(GetParam(), IntrinsicsOrigin::GIVEN));
  EXPECT_EQ(result.status, QueryStatus::INCONSISTENT_INTRINSICS);
  EXPECT_THAT(result.reason, HasSubstr("focal length of"));
  EXPECT_EQ(result.intrinsics.verdict, IntrinsicsVerdict::CONTRADICTED);
  EXPECT_NEAR(result.intrinsics.focal_factor * GetParam(), 1, 0.01);
}

TEST_P(WrongFactors, ExifAndGuessAreRefined) {
  for (const IntrinsicsOrigin origin : {IntrinsicsOrigin::EXIF, IntrinsicsOrigin::GUESS}) {
    const SyntheticScene scene = MakeScene(GetParam(), origin);
    const LocalizationResult result = Localize(scene);
    ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
    EXPECT_EQ(result.intrinsics.verdict, IntrinsicsVerdict::REFINED);
    EXPECT_TRUE(result.is_camera_refined);
    EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 0.01 * scene.median_depth);
  }
}

TEST_P(WrongFactors, ModeGivenOnlyWarns) {
  const LocalizationResult result = Localize(MakeScene(GetParam(), IntrinsicsOrigin::GIVEN), IntrinsicsMode::GIVEN);
  EXPECT_TRUE(HasPose(result.status)) << result.reason;
  EXPECT_THAT(result.intrinsics.contradiction, HasSubstr("px, not the given "));
}

INSTANTIATE_TEST_SUITE_P(CheckIntrinsics, WrongFactors, testing::Values(0.9, 1.05, 1.2));

TEST(CheckIntrinsics, UncalibratedCameraIsLessCertain) {
  const LocalizationResult given = Localize(MakeScene(1, IntrinsicsOrigin::GIVEN));
  const LocalizationResult shared = Localize(MakeScene(1, IntrinsicsOrigin::SHARED));
  ASSERT_EQ(shared.status, QueryStatus::LOCALIZED) << shared.reason;
  EXPECT_EQ(shared.cam_from_world.translation, given.cam_from_world.translation);
  EXPECT_GT(shared.spread.rotation_stddev_rad, given.spread.rotation_stddev_rad);
}

// Makes a scene whose query is by this camera; its intrinsics are guessed.
SyntheticScene MakeGuessedScene(const Camera& camera, uint32_t seed) {
  SyntheticSceneOptions options;
  options.pixel_noise_px = 0.5;
  options.num_database_images = 15;
  options.seed = seed;
  SyntheticScene scene = MakeSyntheticScene(options);
  const RayInCamFunction ray = RaysInCam(scene.problem.query_camera);
  for (Eigen::Vector2d& xy : scene.problem.query_keypoints) xy = ImageFromCam(camera, *ray(xy)).value_or(xy);
  scene.problem.query_camera = CameraFromFocalLength(*CameraModelId("SIMPLE_RADIAL"), 1.2 * 1280, 1280, 960);
  scene.problem.intrinsics_origin = IntrinsicsOrigin::GUESS;
  return scene;
}

class Distortions : public testing::TestWithParam<double> {};

// Checks that radial distortion and a shifted principal point are found with the focal length. Uncorrected, positions
// are off by 2 to 10 % of the scene's depth.
TEST_P(Distortions, OfAGuessedCameraAreEstimated) {
  const Camera camera = {0, *CameraModelId("RADIAL"), 1280, 960, {950, 650, 475, GetParam(), 0.02}};
  for (uint32_t seed = 0; seed < 3; ++seed) {
    const SyntheticScene scene = MakeGuessedScene(camera, seed);
    const LocalizationResult result = Localize(scene);
    ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
    EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 0.01 * scene.median_depth)
        << "seed " << seed;
    EXPECT_NEAR(result.query_camera.params[0], 950, 10) << "seed " << seed;
    EXPECT_NEAR(RadialDistortion(result.query_camera)->x(), GetParam(), 0.03) << "seed " << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(CheckIntrinsics, Distortions, testing::Values(-0.3, -0.1, 0, 0.1));

// Without errors that the points share, the squares of the focal length's errors over its variances have a mean of one.
TEST(CheckIntrinsics, DeviationsOfAGuessedCameraAreThoseOfItsErrors) {
  const Camera camera = {0, *CameraModelId("RADIAL"), 1280, 960, {950, 645, 478, -0.1, 0.02}};
  double sum = 0;
  const int num_scenes = 30;
  for (uint32_t seed = 0; seed < num_scenes; ++seed) {
    const LocalizationResult result = Localize(MakeGuessedScene(camera, seed));
    ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
    const double stddev = result.intrinsics.focal_factor_stddev / result.intrinsics.focal_factor;
    sum += std::pow(std::log(MeanFocalLength(result.query_camera) / 950) / stddev, 2);
  }
  EXPECT_GT(sum / num_scenes, 0.5);
  EXPECT_LT(sum / num_scenes, 2);
}

// A rolling shutter whose camera turns shifts later rows to the side, which no intrinsics explain.
TEST(CheckIntrinsics, GuessedCameraIsLessCertainIfThePhotoIsSkewed) {
  SyntheticScene scene = MakeGuessedScene({0, *CameraModelId("RADIAL"), 1280, 960, {950, 640, 480, 0, 0}}, 0);
  const LocalizationResult still = Localize(scene);
  for (Eigen::Vector2d& xy : scene.problem.query_keypoints) xy.x() += 0.01 * (xy.y() - 480);
  const LocalizationResult turned = Localize(scene);
  ASSERT_EQ(still.status, QueryStatus::LOCALIZED) << still.reason;
  ASSERT_EQ(turned.status, QueryStatus::LOCALIZED) << turned.reason;
  const auto log_stddev = [](const LocalizationResult& result) {
    return result.intrinsics.focal_factor_stddev / result.intrinsics.focal_factor;
  };
  EXPECT_GT(log_stddev(turned), 2 * log_stddev(still));
}

TEST(CheckIntrinsics, GuessedCameraIsLessCertainIfEachDatabaseImageHasAnEstimateOfItsOwn) {
  // Gives each image a focal length of its own, and keeps the rays. stddev: of their logs.
  const auto log_focal_stddev = [](double stddev) {
    SyntheticScene scene = MakeGuessedScene({0, *CameraModelId("RADIAL"), 1280, 960, {950, 640, 480, 0, 0}}, 0);
    const double count = static_cast<double>(scene.problem.pairs.size());
    double place = -(count - 1) / 2;
    for (ImagePair& pair : scene.problem.pairs) {
      const double log_factor = place++ / std::sqrt((count * count + count) / 12) * stddev;
      const Camera before = pair.other_camera;
      pair.other_camera = WithFocalFactor(before, std::exp(log_factor));
      for (Eigen::Vector2d& xy : pair.other_keypoints) {
        xy = *ImageFromCam(pair.other_camera, *RaysInCam(before)(xy));
      }
    }
    const LocalizationResult result = Localize(scene);
    EXPECT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
    return std::pair(result.intrinsics.focal_factor_stddev / result.intrinsics.focal_factor, count);
  };
  const auto [of_one_camera, count] = log_focal_stddev(0);
  const double stddev = 0.02;
  EXPECT_NEAR(log_focal_stddev(stddev).first, std::hypot(of_one_camera, stddev / std::sqrt(count)), of_one_camera / 10);
  EXPECT_NEAR(log_focal_stddev(0.2).first, of_one_camera, of_one_camera / 10) << "cameras with different lenses";
}

TEST(CheckIntrinsics, WrongDistortionIsNamed) {
  SyntheticScene scene = MakeScene(1, IntrinsicsOrigin::GIVEN);
  const Camera ideal = scene.problem.query_camera;
  Camera distorted = ideal;
  distorted.model_id = *CameraModelId("OPENCV");
  distorted.params = {ideal.params[0], ideal.params[1], ideal.params[2], ideal.params[3], -0.3, 0, 0, 0};
  for (Eigen::Vector2d& xy : scene.problem.query_keypoints) xy = *ImageFromCam(distorted, *RaysInCam(ideal)(xy));
  const LocalizationResult result = Localize(scene);
  EXPECT_EQ(result.status, QueryStatus::INCONSISTENT_INTRINSICS);
  EXPECT_THAT(result.reason, HasSubstr("distortion"));
}

}  // namespace
}  // namespace lazyloc

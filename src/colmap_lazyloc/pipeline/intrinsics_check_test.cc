#include "colmap_lazyloc/pipeline/intrinsics_check.h"

#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/math/median.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/intrinsics_estimate.h"
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

TEST(CheckIntrinsics, RightValueIsConfirmedWhateverItsOrigin) {
  for (const IntrinsicsOrigin origin : {IntrinsicsOrigin::GIVEN, IntrinsicsOrigin::EXIF}) {
    const LocalizationResult result = Localize(MakeScene(1, origin));
    EXPECT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
    EXPECT_EQ(result.intrinsics.verdict, IntrinsicsVerdict::CONFIRMED);
    EXPECT_NEAR(result.intrinsics.focal_factor, 1, 5 * result.intrinsics.focal_factor_stddev);
    EXPECT_FALSE(result.is_camera_refined);
  }
}

TEST(SharedErrorVarianceFactor, IsOneWithExactDatabases) {
  Refined refined;
  EXPECT_EQ(SharedErrorVarianceFactor(refined, 0), 4) << "constant database poses";
  refined.adjustment.posed.prior_groups.resize(2);
  refined.adjustment.posed.prior_groups[1].exact_probability = 1;
  EXPECT_EQ(SharedErrorVarianceFactor(refined, 0), 4);
  EXPECT_EQ(SharedErrorVarianceFactor(refined, 1), 1);
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
  EXPECT_THAT(result.intrinsics.contradiction, HasSubstr("focal length"));
}

INSTANTIATE_TEST_SUITE_P(CheckIntrinsics, WrongFactors, testing::Values(0.9, 1.05, 1.2));

// Returns the median distance of a result's points from the query's keypoints, with a camera.
double MedianErrorPx(const LocalizationResult& result, const SyntheticScene& scene, const Camera& camera) {
  std::vector<double> errors_px;
  for (const PointResult& point : result.points) {
    const auto xy = ImageFromCam(camera, result.cam_from_world * point.point_in_world);
    errors_px.push_back((*xy - scene.problem.query_keypoints[point.query_point]).norm());
  }
  return Median(std::move(errors_px));
}

// The keypoints of a camera with another principal point and pixels that are not square.
TEST(CheckIntrinsics, UncalibratedCameraIsCorrectedForWhatTheImagesAskFor) {
  const auto localize = [](IntrinsicsOrigin origin, SyntheticScene* scene) {
    *scene = MakeScene(1, origin);
    const Camera& camera = scene->problem.query_camera;
    const Eigen::Vector2d centre(0.5 * static_cast<double>(camera.width), 0.5 * static_cast<double>(camera.height));
    for (Eigen::Vector2d& xy : scene->problem.query_keypoints) {
      xy += 0.003 * Eigen::Vector2d(-0.5, 0.5).cwiseProduct(xy - centre) + Eigen::Vector2d(6, -6);
    }
    return Localize(*scene);
  };
  SyntheticScene scene;
  const LocalizationResult given = localize(IntrinsicsOrigin::GIVEN, &scene);
  const LocalizationResult exif = localize(IntrinsicsOrigin::EXIF, &scene);
  ASSERT_EQ(given.status, QueryStatus::LOCALIZED) << given.reason;
  ASSERT_EQ(exif.status, QueryStatus::LOCALIZED) << exif.reason;
  const auto error = [&](const LocalizationResult& result) {
    return AngularDistanceRad(result.cam_from_world.rotation, scene.query_cam_from_world.rotation);
  };
  EXPECT_LT(error(exif), 0.5 * error(given));
  EXPECT_GT(exif.spread.rotation_stddev_rad, given.spread.rotation_stddev_rad);
  EXPECT_FALSE(given.is_camera_refined);
  EXPECT_TRUE(exif.is_camera_refined);
  EXPECT_LT((PrincipalPoint(exif.query_camera) - PrincipalPoint(given.query_camera) - Eigen::Vector2d(6, -6)).norm(),
            2);
  EXPECT_LT(MedianErrorPx(exif, scene, exif.query_camera), 1) << "the camera belongs to the pose";
  EXPECT_GT(MedianErrorPx(exif, scene, given.query_camera), 2);
}

TEST(CheckIntrinsics, WrongDistortionIsNamed) {
  SyntheticScene scene = MakeScene(1, IntrinsicsOrigin::GIVEN);
  const Camera ideal = scene.problem.query_camera;
  Camera distorted = ideal;
  distorted.model_id = *CameraModelId("OPENCV");
  distorted.params = {ideal.params[0], ideal.params[1], ideal.params[2], ideal.params[3], -0.3, 0, 0, 0};
  for (Eigen::Vector2d& xy : scene.problem.query_keypoints) xy = *ImageFromCam(distorted, *RayInCam(ideal, xy));
  const LocalizationResult result = Localize(scene);
  EXPECT_EQ(result.status, QueryStatus::INCONSISTENT_INTRINSICS);
  EXPECT_THAT(result.reason, HasSubstr("distortion"));
}

}  // namespace
}  // namespace lazyloc

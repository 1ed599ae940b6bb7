#include "colmap_lazyloc/intrinsics/focal_length.h"

#include <cmath>
#include <vector>

#include <Eigen/Geometry>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/lazy_localizer.h"
#include "colmap_lazyloc/testing/stage_input.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

LocalizerOptions Seeking() {
  LocalizerOptions options;
  options.intrinsics = IntrinsicsMode::REFINE;
  return options;
}

// Makes a scene whose query camera claims a focal length that is off by the factor.
SyntheticScene MakeScene(const SyntheticSceneOptions& options, double factor) {
  SyntheticScene scene = MakeSyntheticScene(options);
  scene.problem.query_camera = WithFocalFactor(scene.problem.query_camera, factor);
  return scene;
}

void ExpectFound(const SyntheticScene& scene, double factor, double max_focal_error, double max_position_error) {
  const LocalizationResult result = LocalizeQuery(scene.problem, Seeking());
  ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason << ", factor " << factor;
  EXPECT_TRUE(result.is_camera_refined);
  for (const int idx : {0, 1}) {
    const double truth = scene.problem.query_camera.params[idx] / factor;
    EXPECT_NEAR(result.query_camera.params[idx] / truth, 1, max_focal_error) << "factor " << factor;
  }
  EXPECT_EQ(result.query_camera.params[2], scene.problem.query_camera.params[2]);
  EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), max_position_error * scene.median_depth);
  EXPECT_LE(RotationErrorDeg(result.cam_from_world, scene.query_cam_from_world), 0.01 + 20 * max_position_error);
}

class Factors : public testing::TestWithParam<double> {};

TEST_P(Factors, NoiseFreeIsExact) {
  SyntheticSceneOptions options;
  for (options.seed = 0; options.seed < 3; ++options.seed) {
    ExpectFound(MakeScene(options, GetParam()), GetParam(), 1e-5, 1e-5);
  }
}

// Checks with relative poses that are as wrong as the focal length that COLMAP would have estimated them with.
TEST_P(Factors, IsFoundWithNoiseAndOutliers) {
  SyntheticSceneOptions options;
  options.num_database_images = 15;
  options.pixel_noise_px = 1;
  options.outlier_match_ratio = 0.1;
  options.outlier_pair_ratio = 0.2;
  options.rotation_noise_deg = options.direction_noise_deg = 20;
  for (options.seed = 0; options.seed < 3; ++options.seed) {
    ExpectFound(MakeScene(options, GetParam()), GetParam(), 0.01, 0.01);
  }
}

TEST_P(Factors, IsFoundFromRawMatches) {
  SyntheticSceneOptions options;
  options.has_geometry = false;
  options.pixel_noise_px = 0.5;
  options.outlier_match_ratio = 0.3;
  ExpectFound(MakeScene(options, GetParam()), GetParam(), 0.01, 0.01);
}

INSTANTIATE_TEST_SUITE_P(FocalLength, Factors, testing::Values(0.5, 0.8, 1, 1.25, 2));

// The search from EXIF's focal length ends at three times and at a third of it.
TEST(FocalLength, IsFoundFromAGuessIfExifIsWrongByAnyFactor) {
  SyntheticSceneOptions options;
  options.pixel_noise_px = 0.5;
  for (const double factor : {0.01, 0.05, 20.0, 1e4}) {
    SyntheticScene scene = MakeScene(options, factor);
    scene.problem.intrinsics_origin = IntrinsicsOrigin::EXIF;
    const LocalizationResult result = LocalizeQuery(scene.problem, LocalizerOptions());
    ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason << ", factor " << factor;
    EXPECT_NEAR(result.query_camera.params[0] / (scene.problem.query_camera.params[0] / factor), 1, 0.01);
    EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 0.01 * scene.median_depth);
  }
}

TEST(FocalLength, DistortedCameraIsRefinedToo) {
  SyntheticSceneOptions options;
  SyntheticScene scene = MakeSyntheticScene(options);
  Camera camera = scene.problem.query_camera;
  camera.model_id = *CameraModelId("OPENCV");
  camera.params = {900, 910, 640, 480, -0.2, 0.05, 1e-3, -1e-3};
  for (Eigen::Vector2d& xy : scene.problem.query_keypoints) {
    xy = *ImageFromCam(camera, *RaysInCam(scene.problem.query_camera)(xy));
  }
  scene.problem.query_camera = WithFocalFactor(camera, 1.5);
  ExpectFound(scene, 1.5, 1e-5, 1e-5);
}

TEST(FocalLength, PixelsOfAnUncalibratedCameraNeedNotBeSquare) {
  SyntheticSceneOptions options;
  options.pixel_noise_px = 0.2;
  options.num_points = 400;
  SyntheticScene scene = MakeSyntheticScene(options);
  const Camera true_camera = scene.problem.query_camera;
  ASSERT_GT(LogAspectRatio(true_camera), 0.01);
  scene.problem.query_camera = CameraFromFocalLength(*CameraModelId("SIMPLE_RADIAL"), 1.2 * true_camera.params[0],
                                                     true_camera.width, true_camera.height);
  scene.problem.intrinsics_origin = IntrinsicsOrigin::GUESS;
  const LocalizationResult result = LocalizeQuery(scene.problem, LocalizerOptions());
  ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
  EXPECT_NEAR(LogAspectRatio(result.query_camera), LogAspectRatio(true_camera), 0.001);
}

TEST(FocalLength, CovarianceMatchesTheErrorsSpread) {
  // Expects 6, the degrees of freedom, as the mean of the squared errors normalised by their covariances. The standard
  // deviation of the mean is sqrt(12 / 20) = 0.77.
  SyntheticSceneOptions options;
  options.pixel_noise_px = 1;
  double sum = 0;
  const int num_trials = 20;
  for (options.seed = 0; options.seed < num_trials; ++options.seed) {
    const SyntheticScene scene = MakeScene(options, 1.25);
    const LocalizationResult result = LocalizeQuery(scene.problem, WithExactDatabase(Seeking()));
    ASSERT_EQ(result.status, QueryStatus::LOCALIZED);
    const Eigen::AngleAxisd rotation_error(scene.query_cam_from_world.rotation *
                                           result.cam_from_world.rotation.conjugate());
    Eigen::Matrix<double, 6, 1> error;
    error << rotation_error.angle() * rotation_error.axis(),
        scene.query_cam_from_world.translation - result.cam_from_world.translation;
    sum += error.dot(result.covariance.ldlt().solve(error));
  }
  EXPECT_GT(sum / num_trials, 4);
  EXPECT_LT(sum / num_trials, 9);
}

// Makes a scene whose points lie in the plane z = 0, seen by the query from a distance of 8 at an angle to the normal.
SyntheticScene MakePlanarScene(double angle_deg, uint32_t seed) {
  SyntheticSceneOptions options;
  options.seed = seed;
  SyntheticScene scene = MakeSyntheticScene(options);
  Random random(seed);
  const double angle = DegToRad(angle_deg);
  scene.query_cam_from_world = LookAt({8 * std::sin(angle), 0, -8 * std::cos(angle)}, {0, 0, 0});
  std::normal_distribution<double> noise_px(0, 0.5);
  const auto project = [&](const Camera& camera, const Rigid3d& cam_from_world, const Eigen::Vector3d& point) {
    const double x = noise_px(random), y = noise_px(random);
    return Eigen::Vector2d(*ImageFromCam(camera, cam_from_world * point) + Eigen::Vector2d{x, y});
  };
  for (size_t i = 0; i < scene.problem.query_keypoints.size(); ++i) {
    const Eigen::Vector3d point(std::remainder(0.37 * i, 5), std::remainder(0.61 * i, 4), 0);
    scene.problem.query_keypoints[i] = project(scene.problem.query_camera, scene.query_cam_from_world, point);
    for (ImagePair& pair : scene.problem.pairs) {
      pair.other_keypoints[i] = project(pair.other_camera, pair.database_cam_from_world, point);
    }
  }
  return scene;
}

// Two database images do not show the errors of their poses, which a focal length explains.
TEST(FocalLength, NeedsThreeDatabaseImages) {
  SyntheticSceneOptions options;
  for (options.num_database_images = 2; options.num_database_images < 4; ++options.num_database_images) {
    const SyntheticScene scene = MakeScene(options, 1);
    EXPECT_EQ(LocalizeQuery(scene.problem, LocalizerOptions()).status, QueryStatus::LOCALIZED);
    const LocalizationResult result = LocalizeQuery(scene.problem, Seeking());
    if (options.num_database_images == 3) {
      EXPECT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
      continue;
    }
    EXPECT_EQ(result.status, QueryStatus::UNKNOWN_CAMERA) << result.reason;
    EXPECT_THAT(result.reason, testing::HasSubstr("fewer than three database images"));
  }
}

// The image of a plane that faces the query fits any focal length at some distance.
TEST(FocalLength, FrontoParallelPlaneLeavesTheDistanceUnobservable) {
  for (uint32_t seed = 0; seed < 10; ++seed) {
    const SyntheticScene scene = MakePlanarScene(0, seed);
    const LocalizationResult given = LocalizeQuery(scene.problem, LocalizerOptions());
    EXPECT_TRUE(HasPose(given.status)) << given.reason << ", seed " << seed;
    EXPECT_EQ(given.intrinsics.verdict, IntrinsicsVerdict::UNOBSERVABLE) << "seed " << seed;
    const LocalizationResult result = LocalizeQuery(scene.problem, Seeking());
    EXPECT_EQ(result.status, QueryStatus::UNKNOWN_CAMERA) << QueryStatusName(result.status) << ", seed " << seed;
    EXPECT_THAT(result.reason, testing::HasSubstr("focal length"));
    EXPECT_FALSE(result.is_camera_refined);
  }
}

// Checks that neither the estimate nor what the images say of the given value leans to longer focal lengths, as errors
// would that shrink as focal length and distance grow together. The standard deviation of the mean is at most 0.22.
TEST(FocalLength, InclinedPlaneDeterminesItWithoutBias) {
  for (const LocalizerOptions& options : {LocalizerOptions(), Seeking()}) {
    double sum = 0;
    const int num_scenes = 20;
    for (uint32_t seed = 0; seed < num_scenes; ++seed) {
      const LocalizationResult result = LocalizeQuery(MakePlanarScene(8, seed).problem, options);
      ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason << ", seed " << seed;
      const double factor = result.intrinsics.focal_factor;
      sum += std::log(factor) / (result.intrinsics.focal_factor_stddev / factor);
    }
    EXPECT_NEAR(sum / num_scenes, 0, 0.5);
  }
}

// Level ground, seen from above by database images with wrong poses, hardly tells the focal length. Estimates from
// different starts may then differ, but not by many of their standard deviations.
TEST(FocalLength, EstimatesOfLevelGroundAgreeWithinTheirDeviations) {
  double sum = 0;
  int num = 0;
  for (uint32_t seed = 0; seed < 20; ++seed) {
    SyntheticScene scene = MakePlanarScene(3, seed);
    Random random(seed);
    for (ImagePair& pair : scene.problem.pairs) {
      pair.database_cam_from_world.rotation =
          ExpSO3(DegToRad(2) * RandomVector(&random).head<3>()) * pair.database_cam_from_world.rotation;
    }
    std::vector<double> logs, variances;
    const Camera camera = scene.problem.query_camera;
    for (const double factor : {0.8, 1.25}) {
      scene.problem.query_camera = WithFocalFactor(camera, factor);
      const LocalizationResult result = LocalizeQuery(scene.problem, Seeking());
      if (!HasPose(result.status)) continue;
      const double found = result.intrinsics.focal_factor;
      logs.push_back(std::log(found * factor));
      variances.push_back(std::pow(result.intrinsics.focal_factor_stddev / found, 2));
    }
    if (logs.size() < 2) continue;
    sum += std::pow(logs[1] - logs[0], 2) / (variances[0] + variances[1]);
    ++num;
  }
  EXPECT_GE(num, 10);
  EXPECT_LE(sum / num, 4);  // 11.7 without the scatter of the starts
}

// With a distortion that nobody has measured, little is left that tells the focal length of a photo of a plane. Far
// from certain, adjustment would lead astray: to a third of the focal length, with deviations of a few percent.
TEST(FocalLength, DistortedPhotosOfPlanesAreRightOrRefused) {
  int num_posed = 0;
  for (const double angle_deg : {3, 20}) {
    for (uint32_t seed = 0; seed < 10; ++seed) {
      SyntheticScene scene = MakePlanarScene(angle_deg, seed);
      Camera& camera = scene.problem.query_camera;
      const double focal_px = camera.params[0];
      const Camera distorted = {
          0, *CameraModelId("RADIAL"), camera.width, camera.height, {focal_px, 650, 475, -0.15, 0.01}};
      const RayInCamFunction ray = RaysInCam(camera);
      for (Eigen::Vector2d& xy : scene.problem.query_keypoints) xy = ImageFromCam(distorted, *ray(xy)).value_or(xy);
      camera = CameraFromFocalLength(*CameraModelId("SIMPLE_RADIAL"), 1.5 * focal_px, camera.width, camera.height);
      scene.problem.intrinsics_origin = IntrinsicsOrigin::GUESS;
      const LocalizationResult result = LocalizeQuery(scene.problem, LocalizerOptions());
      if (!HasPose(result.status)) continue;
      ++num_posed;
      const auto& [factor, stddev] = std::pair(result.intrinsics.focal_factor, result.intrinsics.focal_factor_stddev);
      EXPECT_LE(std::abs(std::log(1.5 * factor)), 5 * stddev / factor)
          << factor << " +- " << stddev << ", " << angle_deg << " degrees, seed " << seed;
    }
  }
  EXPECT_GE(num_posed, 10);
}

TEST(FocalLength, NoPointFromTheDatabaseIsReported) {
  SyntheticSceneOptions options;
  options.num_database_images = 1;
  const LocalizationResult result = LocalizeQuery(MakeSyntheticScene(options).problem, Seeking());
  EXPECT_EQ(result.status, QueryStatus::TOO_FEW_TRACKS);
  EXPECT_THAT(result.reason, testing::HasSubstr("focal length"));
}

SyntheticGroup LoneQueryOfGroup() {
  SyntheticGroupOptions options;
  options.num_sensors = 1;
  options.num_points = 60;
  options.pixel_noise_px = 0.5;
  return MakeSyntheticGroup(options);
}

// Allows an error of 8 %, because neighbours in the grid of focal lengths differ by that.
TEST(ChooseFocalLengthAndPose, NearestOfTheGridIsFound) {
  const SyntheticGroup scene = LoneQueryOfGroup();
  const StageInput input = MakeStageInput(scene);
  for (const double factor : {0.5, 1.0, 2.5}) {
    LocalizationProblem problem = scene.group.images[0].problem;
    problem.query_camera = WithFocalFactor(problem.query_camera, factor);
    const FocalLengthAndPose found =
        ChooseFocalLengthAndPose(input.layout, QueryCamera(problem), input.tracks, LocalizerOptions());
    EXPECT_NEAR(found.factor * factor, 1, 0.08) << factor;
    EXPECT_LE(PositionError(found.frame_from_world, input.truth.frames[0].frame_from_world), 1);
    EXPECT_LE(RotationErrorDeg(found.frame_from_world, input.truth.frames[0].frame_from_world), 1);
  }
}

TEST(ChooseFocalLengthAndPose, FactorIsOneForTheTruth) {
  const SyntheticGroup scene = LoneQueryOfGroup();
  const StageInput input = MakeStageInput(scene);
  const QueryCamera camera(scene.group.images[0].problem);
  EXPECT_EQ(ChooseFocalLengthAndPose(input.layout, camera, input.tracks, LocalizerOptions()).factor, 1);
}

TEST(ChooseFocalLengthAndPose, TooFewTracksAreReported) {
  const SyntheticGroup scene = LoneQueryOfGroup();
  StageInput input = MakeStageInput(scene);
  input.tracks.resize(3);
  const Failure failure = FailureOf(
      [&] { ChooseFocalLengthAndPose(input.layout, QueryCamera(scene.group.images[0].problem), input.tracks, {}); });
  EXPECT_EQ(failure.cause, QueryStatus::TOO_FEW_TRACKS);
  EXPECT_THAT(failure.reason, testing::HasSubstr("3 points"));
}

// Neither the order of the estimates nor the cost of an adjustment counts.
TEST(MostLikelyFocalLength, IsTheOneThatFitsThePointsFromTheDatabase) {
  const SyntheticGroup scene = LoneQueryOfGroup();
  const StageInput input = MakeStageInput(scene);
  std::vector<Refined> estimates;
  for (const double factor : {1.2, 1.0, 0.9}) {
    Refined& estimate = estimates.emplace_back();
    estimate.camera = QueryCamera(scene.group.images[0].problem);
    estimate.camera->ScaleFocalLength(factor);
    estimate.adjustment.posed = input.truth;
    estimate.adjustment.summary.cost = std::abs(factor - 1.2);
  }
  const Refined chosen = MostLikelyFocalLength(estimates, input.tracks, {});
  EXPECT_EQ(chosen.camera->FocalFactor(), 1);
  EXPECT_NEAR(chosen.log_focal_scatter, (std::pow(std::log(1.2), 2) + std::pow(std::log(0.9), 2)) / 2, 1e-12);
}

}  // namespace
}  // namespace lazyloc

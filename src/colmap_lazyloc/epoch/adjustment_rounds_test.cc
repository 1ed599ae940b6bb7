#include "colmap_lazyloc/epoch/adjustment_rounds.h"

#include <cmath>
#include <random>
#include <utility>

#include <gmock/gmock.h>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/bridge/colmap_program.h"
#include "colmap_lazyloc/group/uncalibrated_camera.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/pose_distribution.h"
#include "colmap_lazyloc/testing/pose_expectations.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

Camera MakeCamera() {
  return CameraFromFocalLength(*CameraModelId("SIMPLE_RADIAL"), /*focal_length_px=*/600, 800, 600);
}

struct SceneOptions {
  int num_photos = 6, num_database = 6;
  double noise_px = 0.5;
  double pose_error_deg = 0.2, position_error = 0.05;  // of the photos; the scene spans about 10
  Camera photo_camera = MakeCamera();
  double focal_factor = 1;   // on the photos' focal length
  double outlier_ratio = 0;  // of matches
  int num_points = 300;
  double database_error_deg = 0, database_error = 0;  // independent ones
  double drift = 0;                                   // of the frame that the database defines, in position
  uint32_t seed = 1;
};

struct TestScene {
  JointScene given, exact;
};

void Drift(double distance, JointImage* image) {
  const Eigen::Vector3d centre = CamInWorld(image->cam_from_world);
  const double angle = 2 * std::atan2(centre.y(), centre.x());
  image->cam_from_world = CamFromWorld(image->cam_from_world.rotation,
                                       centre + distance * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0));
}

void Disturb(double error_deg, double position_error, Random* random, JointImage* image) {
  const Eigen::Vector3d centre = CamInWorld(image->cam_from_world);
  image->cam_from_world = CamFromWorld(Disturbed(image->cam_from_world.rotation, error_deg, random),
                                       centre + position_error * RandomVector(random).normalized());
}

// Returns photos and database images in turn around points that all of them see.
TestScene MakeScene(const SceneOptions& options) {
  SilenceLogging();  // COLMAP warns of matches that occur twice
  Random random(options.seed);
  std::normal_distribution<double> normal;
  TestScene scene;
  scene.exact.cameras = {{options.photo_camera, false}, {MakeCamera(), true}};
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < options.num_points; ++i) points.push_back(RandomVector(&random));
  const int num_images = options.num_photos + options.num_database;
  for (int i = 0; i < num_images; ++i) {
    const double angle = 2 * M_PI * (5 * i % num_images) / num_images;  // photos between database images
    const Eigen::Vector3d centre(8 * std::cos(angle), 8 * std::sin(angle), 0.5 * normal(random));
    const bool is_database = i >= options.num_photos;
    JointImage image = {is_database ? 1 : 0, LookAt(centre, Eigen::Vector3d::Zero()), is_database, 1, {}};
    for (const Eigen::Vector3d& point : points) {
      const Eigen::Vector2d xy = *ImageFromCam(scene.exact.cameras[image.camera].camera, image.cam_from_world * point);
      image.keypoints.emplace_back(xy + options.noise_px * Eigen::Vector2d(normal(random), normal(random)));
    }
    scene.exact.images.push_back(std::move(image));
  }
  std::bernoulli_distribution is_outlier(options.outlier_ratio);
  std::uniform_int_distribution<uint32_t> keypoint(0, static_cast<uint32_t>(points.size()) - 1);
  for (int i = 0; i < options.num_photos; ++i) {
    for (int j = i + 1; j < num_images; ++j) {
      JointPair pair = {j, i, {}};
      for (uint32_t k = 0; k < points.size(); ++k) {
        pair.matches.push_back({k, is_outlier(random) ? keypoint(random) : k});
      }
      scene.exact.pairs.push_back(std::move(pair));
    }
  }
  for (JointImage& image : scene.exact.images) Drift(options.drift, &image);
  scene.given = scene.exact;
  scene.given.cameras[0].camera = WithFocalFactor(options.photo_camera, options.focal_factor);
  for (JointImage& image : scene.given.images) {
    if (!image.is_database) {
      Disturb(options.pose_error_deg, options.position_error, &random, &image);
    } else if (options.database_error > 0) {
      Disturb(options.database_error_deg, options.database_error, &random, &image);
    }
  }
  return scene;
}

// Returns the mean position error of the photos.
double MeanPositionError(const JointScene& scene, const JointScene& exact) {
  double sum = 0;
  int count = 0;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    if (scene.images[i].is_database) continue;
    sum += PositionError(scene.images[i].cam_from_world, exact.images[i].cam_from_world);
    ++count;
  }
  return sum / count;
}

// Returns the mean squared error of the poses by their covariances, per degree of freedom.
double NormalizedError(const AdjustedPhotos& adjustment, const JointScene& scene, const JointScene& exact) {
  double sum = 0;
  int count = 0;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    if (scene.images[i].is_database) continue;
    const Rigid3d &pose = scene.images[i].cam_from_world, &truth = exact.images[i].cam_from_world;
    Eigen::Matrix<double, 6, 1> error;
    const Eigen::AngleAxisd turn(pose.rotation * truth.rotation.conjugate());
    error << turn.angle() * turn.axis(), pose.translation - truth.translation;
    sum += error.dot(adjustment.covariances[i].ldlt().solve(error));
    count += 6;
  }
  return sum / count;
}

TEST(AdjustInRounds, NoiseFreeIsExact) {
  SceneOptions options;
  options.noise_px = 0;
  TestScene scene = MakeScene(options);
  const AdjustedPhotos adjustment = AdjustInRounds(&scene.given);
  ASSERT_TRUE(adjustment.summary.success) << adjustment.summary.message;
  EXPECT_LT(MeanPositionError(scene.given, scene.exact), 1e-6);
  EXPECT_EQ(scene.given.points.size(), 300u);
}

TEST(AdjustInRounds, DatabaseImagesAndConstantCamerasKeepEveryBit) {
  TestScene scene = MakeScene({});
  const JointScene before = scene.given;
  ASSERT_TRUE(AdjustInRounds(&scene.given).summary.success);
  EXPECT_EQ(scene.given.cameras[1].camera.params, before.cameras[1].camera.params);
  EXPECT_NE(scene.given.cameras[0].camera.params, before.cameras[0].camera.params);
  for (size_t i = 0; i < before.images.size(); ++i) {
    if (!before.images[i].is_database) continue;
    EXPECT_EQ(scene.given.images[i].cam_from_world.rotation.coeffs(),
              before.images[i].cam_from_world.rotation.coeffs());
    EXPECT_EQ(scene.given.images[i].cam_from_world.translation, before.images[i].cam_from_world.translation);
  }
}

// 300 points in a depth of 1 with 0.5 px at 600 px and a distance of 8 determine a position towards the points to about
// 8 * 8 / 600 * 0.5 / sqrt(300) = 0.003, and to twice as much because the focal length is estimated, too.
TEST(AdjustInRounds, NoiseAverages) {
  TestScene scene = MakeScene({});
  const AdjustedPhotos adjustment = AdjustInRounds(&scene.given);
  ASSERT_TRUE(adjustment.summary.success);
  EXPECT_LT(MeanPositionError(scene.given, scene.exact), 0.008);
  for (const JointImage& image : scene.given.images) EXPECT_NEAR(image.noise_px, 0.5, 0.1);
}

TEST(AdjustInRounds, SharedFocalLengthIsFound) {
  SceneOptions options;
  options.focal_factor = 1.03;
  TestScene scene = MakeScene(options);
  ASSERT_TRUE(AdjustInRounds(&scene.given).summary.success);
  EXPECT_NEAR(MeanFocalLength(scene.given.cameras[0].camera), 600, 2);
  EXPECT_LT(MeanPositionError(scene.given, scene.exact), 0.01);
}

// Coefficients of the distortion are large behind a long lens: this one moves the corners by 6 %.
TEST(AdjustInRounds, PhotosOfALongLensAreAdjusted) {
  SceneOptions options;
  options.photo_camera.params = {/*f=*/2400, 400, 300, /*k=*/1.4};
  options.pose_error_deg = 0.05;
  options.position_error = 0.0125;
  TestScene scene = MakeScene(options);
  ASSERT_TRUE(AdjustInRounds(&scene.given).summary.success);
  EXPECT_GT(scene.given.points.size(), 250u);
  EXPECT_LT(MeanPositionError(scene.given, scene.exact), 0.008);
}

// The images would correct the intrinsics, but these were estimated before with errors that the images share.
TEST(AdjustInRounds, CovariancesContainTheErrorsOfConstantIntrinsics) {
  SceneOptions options;
  options.photo_camera = WithAllCorrections(MakeCamera());
  IntrinsicsCorrections stddevs;
  stddevs << /*log f=*/0.01, /*px=*/4, 4, /*log aspect ratio=*/0.002, /*px at 1000 px=*/4, 4;
  double sum = 0;
  constexpr uint32_t kNumScenes = 20;
  for (options.seed = 1; options.seed <= kNumScenes; ++options.seed) {
    TestScene scene = MakeScene(options);
    Random random(options.seed);
    std::normal_distribution<double> normal;
    JointCamera& camera = scene.given.cameras[0];
    camera.camera =
        Corrected(options.photo_camera, stddevs.unaryExpr([&](double stddev) { return stddev * normal(random); }));
    camera.is_constant = true;
    camera.covariance = stddevs.cwiseAbs2().asDiagonal();
    const std::vector<double> params = camera.camera.params;
    const AdjustedPhotos adjustment = AdjustInRounds(&scene.given);
    ASSERT_TRUE(adjustment.summary.success);
    EXPECT_EQ(camera.camera.params, params);
    sum += NormalizedError(adjustment, scene.given, scene.exact);
  }
  EXPECT_GT(sum / kNumScenes, 0.5);
  EXPECT_LT(sum / kNumScenes, 2);
}

TEST(AdjustInRounds, FalseMatchesAreLeftOut) {
  SceneOptions options;
  options.outlier_ratio = 0.1;
  TestScene scene = MakeScene(options);
  ASSERT_TRUE(AdjustInRounds(&scene.given).summary.success);
  EXPECT_LT(MeanPositionError(scene.given, scene.exact), 0.006);
}

TEST(AdjustInRounds, PhotosWithoutDatabaseImagesHangOnOthers) {
  TestScene scene = MakeScene({});
  auto& pairs = scene.given.pairs;
  const auto sees_database = [&](const JointPair& pair) {
    return (pair.image1 == 0 || pair.image2 == 0) &&
           (scene.given.images[pair.image1].is_database || scene.given.images[pair.image2].is_database);
  };
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(), sees_database), pairs.end());
  ASSERT_TRUE(AdjustInRounds(&scene.given).summary.success);
  EXPECT_LT(PositionError(scene.given.images[0].cam_from_world, scene.exact.images[0].cam_from_world), 0.01);
}

TEST(AdjustInRounds, CovariancesDescribeTheErrors) {
  double sum = 0;
  constexpr int kNumScenes = 10;
  for (uint32_t seed = 0; seed < kNumScenes; ++seed) {
    SceneOptions options;
    options.seed = seed;
    TestScene scene = MakeScene(options);
    const AdjustedPhotos adjustment = AdjustInRounds(&scene.given);
    ASSERT_TRUE(adjustment.summary.success);
    sum += NormalizedError(adjustment, scene.given, scene.exact);
  }
  EXPECT_NEAR(sum / kNumScenes, 1, 0.4);
}

// Returns the means over some scenes.
std::pair<double, double> MeanErrors(SceneOptions options) {
  constexpr int kNumScenes = 5;
  double error = 0, normalized_error = 0;
  for (options.seed = 0; options.seed < kNumScenes; ++options.seed) {
    TestScene scene = MakeScene(options);
    const AdjustedPhotos adjusted = AdjustInRounds(&scene.given);
    EXPECT_TRUE(adjusted.summary.success);
    error += MeanPositionError(scene.given, scene.exact) / kNumScenes;
    normalized_error += NormalizedError(adjusted, scene.given, scene.exact) / kNumScenes;
  }
  return {error, normalized_error};
}

// Errors of 0.1 degrees and 0.02 displace keypoints by 1 and 1.5 px, three times the noise.
TEST(AdjustInRounds, DatabasePosesMayBeOff) {
  SceneOptions options;
  options.num_database = 12;
  options.database_error_deg = 0.1;
  options.database_error = 0.02;
  const auto [error, normalized_error] = MeanErrors(options);
  EXPECT_LT(error, 0.025);
  EXPECT_GT(normalized_error, 0.2);
  EXPECT_LT(normalized_error, 2);
}

// Photos are where the frame of the nearest database images has them.
TEST(AdjustInRounds, DatabasePosesMayDrift) {
  SceneOptions options;
  options.num_database = 18;
  options.drift = 0.015;
  const auto [error, normalized_error] = MeanErrors(options);
  EXPECT_LT(error, 0.015);
  EXPECT_GT(normalized_error, 0.2);
  EXPECT_LT(normalized_error, 2);
}

SceneOptions MoreDatabaseImagesThanADenseMatrixSolves() {
  SceneOptions options;
  options.num_database = 160;
  options.num_points = 40;
  return options;
}

TEST(AdjustInRounds, ManyDatabasePosesMayDrift) {
  SceneOptions options = MoreDatabaseImagesThanADenseMatrixSolves();
  options.drift = 0.015;
  TestScene scene = MakeScene(options);
  ASSERT_TRUE(AdjustInRounds(&scene.given).summary.success);
  EXPECT_LT(MeanPositionError(scene.given, scene.exact), 0.045);
}

TEST(AdjustInRounds, SizesOfManyDatabaseErrorsAreEstimated) {
  SceneOptions options = MoreDatabaseImagesThanADenseMatrixSolves();
  options.database_error_deg = 0.1;
  options.database_error = 0.02;
  TestScene scene = MakeScene(options);
  const AdjustedPhotos adjusted = AdjustInRounds(&scene.given);
  ASSERT_TRUE(adjusted.summary.success);
  EXPECT_LT(MeanPositionError(scene.given, scene.exact), 0.045);
  const double normalized_error = NormalizedError(adjusted, scene.given, scene.exact);
  EXPECT_GT(normalized_error, 0.2);
  EXPECT_LT(normalized_error, 2.5);
}

// Adds control points, which all images show.
void AddControlPoints(int count, double stddev, double mark_noise_px, TestScene* scene) {
  Random random(99);
  std::normal_distribution<double> normal;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d place = RandomVector(&random);
    JointPoint point;
    const Eigen::Vector3d error(normal(random), normal(random), normal(random));
    point.survey = Survey{place + stddev * error, Eigen::Vector3d::Constant(stddev), mark_noise_px};
    for (size_t image = 0; image < scene->given.images.size(); ++image) {
      std::vector<Eigen::Vector2d>& keypoints = scene->given.images[image].keypoints;
      point.observations.push_back({static_cast<int>(image), static_cast<uint32_t>(keypoints.size())});
      const Eigen::Vector2d noise(normal(random), normal(random));
      keypoints.emplace_back(*ImageFromCam(MakeCamera(), scene->exact.images[image].cam_from_world * place) +
                             mark_noise_px * noise);
    }
    scene->given.control_points.push_back(std::move(point));
  }
}

// Moves the database, and the photos with it, away from the survey.
void Shift(const Eigen::Vector3d& shift, JointScene* scene) {
  for (JointImage& image : scene->images) {
    image.cam_from_world = CamFromWorld(image.cam_from_world.rotation, CamInWorld(image.cam_from_world) + shift);
  }
}

// The shift displaces keypoints by up to 20 px. Eight points with a deviation of 0.005 show it to 0.002.
TEST(AdjustInRounds, PhotosAreInTheFrameOfControlPoints) {
  const Eigen::Vector3d shift(0.2, -0.1, 0.15);
  double without = 0, with = 0, normalized_error = 0;
  constexpr int kNumScenes = 5;
  for (uint32_t seed = 0; seed < kNumScenes; ++seed) {
    SceneOptions options;
    options.num_database = 12;
    options.seed = seed;
    TestScene scene = MakeScene(options);
    Shift(shift, &scene.given);
    TestScene controlled = scene;
    AddControlPoints(8, 0.005, 0.5, &controlled);
    ASSERT_TRUE(AdjustInRounds(&scene.given).summary.success);
    const AdjustedPhotos adjusted = AdjustInRounds(&controlled.given);
    ASSERT_TRUE(adjusted.summary.success);
    EXPECT_TRUE(adjusted.control.wrong.empty());
    without += MeanPositionError(scene.given, scene.exact) / kNumScenes;
    with += MeanPositionError(controlled.given, scene.exact) / kNumScenes;
    normalized_error += NormalizedError(adjusted, controlled.given, scene.exact) / kNumScenes;
    EXPECT_EQ(controlled.given.images.back().cam_from_world.translation,
              scene.given.images.back().cam_from_world.translation);
  }
  EXPECT_NEAR(without, shift.norm(), 0.02);
  EXPECT_LT(with, 0.012);
  EXPECT_GT(normalized_error, 0.2);
  EXPECT_LT(normalized_error, 2);
}

TEST(AdjustInRounds, PhotosLeaveAFrameOfManyDatabaseImages) {
  TestScene scene = MakeScene(MoreDatabaseImagesThanADenseMatrixSolves());
  Shift({0.2, -0.1, 0.15}, &scene.given);
  AddControlPoints(8, 0.005, 0.5, &scene);
  ASSERT_TRUE(AdjustInRounds(&scene.given).summary.success);
  EXPECT_LT(MeanPositionError(scene.given, scene.exact), 0.045);
}

TEST(AdjustInRounds, WrongMarkOfAControlPointIsLeftOut) {
  TestScene scene = MakeScene({});
  AddControlPoints(8, 0.005, 0.5, &scene);
  TestScene wrong = scene;
  JointImage& photo = wrong.given.images[2];
  photo.keypoints.back().x() += 60;
  ASSERT_TRUE(AdjustInRounds(&scene.given).summary.success);
  const AdjustedPhotos adjusted = AdjustInRounds(&wrong.given);
  ASSERT_EQ(adjusted.control.wrong.size(), 1u);
  EXPECT_EQ(adjusted.control.wrong[0].control_point, 7u);
  EXPECT_EQ(adjusted.control.wrong[0].image, 2);
  EXPECT_LT(PositionError(photo.cam_from_world, scene.given.images[2].cam_from_world), 0.003);
}

// A survey that says less than the database leaves the photos where the database has them.
TEST(AdjustInRounds, InexactControlPointsDoNotMovePhotos) {
  TestScene scene = MakeScene({});
  AddControlPoints(4, 0.5, 0.5, &scene);
  ASSERT_TRUE(AdjustInRounds(&scene.given).summary.success);
  EXPECT_LT(MeanPositionError(scene.given, scene.exact), 0.012);
}

TEST(AdjustInRounds, PhotoWithTooFewMatchesKeepsItsPose) {
  TestScene scene = MakeScene({});
  for (JointPair& pair : scene.given.pairs) {
    if (pair.image1 == 0 || pair.image2 == 0) pair.matches.resize(10);
  }
  const Rigid3d before = scene.given.images[0].cam_from_world;
  const AdjustedPhotos adjustment = AdjustInRounds(&scene.given);
  ASSERT_TRUE(adjustment.summary.success);
  EXPECT_EQ(scene.given.images[0].cam_from_world.translation, before.translation);
  EXPECT_FALSE(adjustment.covariances[0].allFinite());
}

TEST(AdjustInRounds, SameInputSameResult) {
  TestScene first = MakeScene({}), second = MakeScene({});
  ASSERT_TRUE(AdjustInRounds(&first.given).summary.success);
  ASSERT_TRUE(AdjustInRounds(&second.given).summary.success);
  EXPECT_EQ(first.given.images[0].cam_from_world.translation, second.given.images[0].cam_from_world.translation);
}

TEST(AdjustInRounds, SceneWithoutMatchesIsNotAdjusted) {
  TestScene scene = MakeScene({});
  scene.given.pairs.clear();
  EXPECT_FALSE(AdjustInRounds(&scene.given).summary.success);
}

}  // namespace
}  // namespace lazyloc

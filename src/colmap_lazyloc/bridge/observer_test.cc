#include "colmap_lazyloc/bridge/observer.h"

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

struct ModelCase {
  const char* name;
  std::vector<double> params;
};

class Models : public testing::TestWithParam<ModelCase> {
 protected:
  Camera MakeCamera() const {
    Camera camera;
    camera.model_id = *CameraModelId(GetParam().name);
    camera.width = 640;
    camera.height = 480;
    camera.params = GetParam().params;
    return camera;
  }
};

// The observation's error must be the difference in pixels, to first order, everywhere in the image.
TEST_P(Models, ErrorIsPixelsToFirstOrder) {
  const Camera camera = MakeCamera();
  ASSERT_EQ(CameraProblem(camera), "");
  const Observer observe(camera);
  for (const Eigen::Vector2d& xy : {Eigen::Vector2d(320, 240), Eigen::Vector2d(40, 60), Eigen::Vector2d(600, 450)}) {
    const std::optional<Observation> observation = observe(xy);
    ASSERT_TRUE(observation.has_value());
    for (const Eigen::Vector2d& offset : {Eigen::Vector2d(0, 0), Eigen::Vector2d(0.8, -0.6), Eigen::Vector2d(0, 2)}) {
      const Eigen::Vector3d point = 7.5 * *RaysInCam(camera)(xy + offset);
      EXPECT_TRUE(IsInFront(*observation, point));
      EXPECT_LE((ReprojectionError(*observation, point) - offset).norm(), 1e-6 + 5e-3 * offset.norm());
      EXPECT_LE((*ImageFromCam(camera, point) - xy - offset).norm(), 1e-6);
    }
    EXPECT_FALSE(IsInFront(*observation, -observation->ray_in_cam));
  }
}

TEST_P(Models, FocalLengthMovesTheImagePointAsStated) {
  const Camera camera = MakeCamera();
  constexpr double kStep = 1e-4;
  const Camera shorter = WithFocalFactor(camera, std::exp(-kStep)), longer = WithFocalFactor(camera, std::exp(kStep));
  for (const Eigen::Vector2d& xy : {Eigen::Vector2d(320, 240), Eigen::Vector2d(40, 60), Eigen::Vector2d(600, 450)}) {
    const std::optional<Observation> observation = Observer(camera)(xy);
    ASSERT_TRUE(observation);
    const Eigen::Vector3d& ray = observation->ray_in_cam;
    const Eigen::Vector2d px_from_log_focal = (*ImageFromCam(longer, ray) - *ImageFromCam(shorter, ray)) / (2 * kStep);
    EXPECT_LE((observation->px_from_log_focal - px_from_log_focal).norm(), 1e-4 * (1 + px_from_log_focal.norm()));
  }
}

INSTANTIATE_TEST_SUITE_P(Observation, Models,
                         testing::Values(ModelCase{"SIMPLE_PINHOLE", {500, 320, 240}},
                                         ModelCase{"PINHOLE", {500, 520, 310, 250}},
                                         ModelCase{"RADIAL", {500, 320, 240, -0.1, 0.02}},
                                         ModelCase{"OPENCV", {500, 510, 320, 240, -0.1, 0.02, 1e-3, -1e-3}},
                                         ModelCase{"OPENCV_FISHEYE", {300, 300, 320, 240, 0.01, 0.002, 0, 0}},
                                         ModelCase{"FOV", {400, 400, 320, 240, 0.7}}),
                         [](const auto& param_info) { return param_info.param.name; });

// Looks to all sides of a spherical camera, and across the border of its image.
TEST(Equirectangular, RaysAndDerivativesHoldOnTheWholeSphere) {
  const Camera camera{1, *CameraModelId("EQUIRECTANGULAR"), 1000, 500, {1000, 500}, false};
  EXPECT_EQ(CameraProblem(camera), "");
  EXPECT_FALSE(MeanFocalLengthPx(camera).has_value());
  EXPECT_LT(((*RaysInCam(camera)({500, 250})) - Eigen::Vector3d::UnitZ()).norm(), 1e-12);
  EXPECT_LT(((*RaysInCam(camera)({750, 250})) - Eigen::Vector3d::UnitX()).norm(), 1e-12);
  EXPECT_LT(((*RaysInCam(camera)({500, 500})) - Eigen::Vector3d::UnitY()).norm(), 1e-12);
  const Observer observe(camera);
  for (const double x : {0.02, 130.0, 400.0, 730.0, 999.97}) {
    for (const double y : {20.0, 140.0, 250.0, 410.0, 480.0}) {
      const Eigen::Vector2d xy(x, y), shift(0.03, -0.04);
      const std::optional<Observation> observation = observe(xy);
      ASSERT_TRUE(observation.has_value());
      const Eigen::Vector3d point = 3 * *RaysInCam(camera)(xy + shift);
      EXPECT_TRUE(IsInFront(*observation, point));
      EXPECT_FALSE(IsInFront(*observation, -point));
      EXPECT_LT((ReprojectionError(*observation, point) - shift).norm(), 0.01) << xy.transpose();
      const Eigen::Vector2d again = *ImageFromCam(camera, 7 * observation->ray_in_cam);
      EXPECT_LT((again - xy).norm(), 1e-8);
    }
  }
}

TEST(WithFocalFactor, ScalesTheFocalLengthsAlone) {
  Camera camera;
  camera.model_id = *CameraModelId("OPENCV");
  camera.params = {500, 510, 320, 240, -0.1, 0.02, 1e-3, -1e-3};
  EXPECT_EQ(WithFocalFactor(camera, 2).params, (std::vector<double>{1000, 1020, 320, 240, -0.1, 0.02, 1e-3, -1e-3}));
  camera.model_id = *CameraModelId("SIMPLE_RADIAL_FISHEYE");
  camera.params = {500, 320, 240, -0.1};
  EXPECT_EQ(WithFocalFactor(camera, 0.5).params, (std::vector<double>{250, 320, 240, -0.1}));
}

TEST(OriginOfStoredCamera, IsJudgedByItsLook) {
  Camera camera = CameraFromFocalLength(*CameraModelId("SIMPLE_RADIAL"), 700, 640, 480);
  EXPECT_EQ(OriginOfStoredCamera(camera), IntrinsicsOrigin::EXIF);
  camera.has_prior_focal_length = false;
  EXPECT_EQ(OriginOfStoredCamera(camera), IntrinsicsOrigin::GIVEN) << "somebody wrote another value than COLMAP's";
  camera.params[0] = 1.2 * 640;
  EXPECT_EQ(OriginOfStoredCamera(camera), IntrinsicsOrigin::GUESS);
  camera.params[3] = -0.01;
  EXPECT_EQ(OriginOfStoredCamera(camera), IntrinsicsOrigin::GIVEN) << "distortion is calibrated";
  camera = CameraFromFocalLength(*CameraModelId("PINHOLE"), 700, 640, 480);
  EXPECT_EQ(OriginOfStoredCamera(camera), IntrinsicsOrigin::EXIF);
  camera.params[2] += 1;
  EXPECT_EQ(OriginOfStoredCamera(camera), IntrinsicsOrigin::GIVEN) << "a principal point is calibrated";
}

// Models that COLMAP 4 added must work if the linked COLMAP knows them; otherwise the message must say what to do.
TEST(CameraProblem, ModelOfANewerColmapIsNamedWithTheRemedy) {
  const std::vector<ModelCase> models = {
      {"RAD_TAN_THIN_PRISM_FISHEYE", {300, 300, 320, 240, 0.01, 0, 0, 0, 0, 0, 1e-3, 0, 0, 0, 0, 0}},
      {"SIMPLE_DIVISION", {500, 320, 240, 0.01}},
      {"DIVISION", {500, 500, 320, 240, 0.01}},
      {"SIMPLE_FISHEYE", {300, 320, 240}},
      {"FISHEYE", {300, 300, 320, 240}},
      {"EUCM", {300, 300, 320, 240, 0.5, 1}}};
  for (size_t i = 0; i < models.size(); ++i) {
    Camera camera{1, *CameraModelId(models[i].name), 640, 480, models[i].params, false};
    EXPECT_EQ(camera.model_id, 11 + i);
    EXPECT_EQ(CameraModelName(camera.model_id), models[i].name);
    const std::string problem = CameraProblem(camera);
    if (problem.empty()) {
      const Eigen::Vector2d xy(300, 250);
      EXPECT_LE((*ImageFromCam(camera, *RaysInCam(camera)(xy)) - xy).norm(), 1e-6) << models[i].name;
    } else {
      EXPECT_NE(problem.find(std::string("does not know camera model ") + models[i].name), std::string::npos)
          << problem;
      EXPECT_NE(problem.find("build against a newer COLMAP 4"), std::string::npos) << problem;
    }
  }
}

TEST(CameraProblem, NamesWhatIsWrong) {
  Camera camera;
  camera.model_id = 99;
  EXPECT_NE(CameraProblem(camera).find("unknown camera model 99"), std::string::npos);
  camera.model_id = *CameraModelId("PINHOLE");
  camera.width = camera.height = 10;
  EXPECT_NE(CameraProblem(camera).find("takes 4 parameters, not 0"), std::string::npos);
  camera.params = {-1, 1, 5, 5};
  EXPECT_NE(CameraProblem(camera).find("focal length"), std::string::npos);
  camera.params = {1, std::nan(""), 5, 5};
  EXPECT_NE(CameraProblem(camera).find("not a finite number"), std::string::npos);
  camera.params = {1, 1, 5, 5};
  EXPECT_EQ(CameraProblem(camera), "");
  camera.width = 0;
  EXPECT_NE(CameraProblem(camera).find("size is zero"), std::string::npos);
}

}  // namespace
}  // namespace lazyloc

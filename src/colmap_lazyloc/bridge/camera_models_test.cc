#include "colmap_lazyloc/bridge/camera_models.h"

#include <cmath>
#include <string>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

class WithCorrectionsTest : public testing::TestWithParam<std::string> {};

TEST_P(WithCorrectionsTest, ImagePointsMoveAsStated) {
  const Camera camera = CameraFromFocalLength(*CameraModelId(GetParam()), 800, 1000, 600);
  const Eigen::Vector2d shift(3, -2);
  const double log_aspect_ratio = 0.002, cubic_distortion = 1e-8;
  const Camera corrected = WithCorrections(camera, shift, log_aspect_ratio, cubic_distortion);
  EXPECT_EQ(CameraProblem(corrected), "");
  for (const Eigen::Vector3d& point : {Eigen::Vector3d(0, 0, 1), {0.4, 0.1, 1}, {-0.2, 0.3, 1}}) {
    const Eigen::Vector2d offset = *ImageFromCam(camera, point) - PrincipalPoint(camera);
    const Eigen::Vector2d expected = shift + log_aspect_ratio * Eigen::Vector2d(-0.5, 0.5).cwiseProduct(offset) +
                                     cubic_distortion * offset.squaredNorm() * offset;
    const Eigen::Vector2d moved = *ImageFromCam(corrected, point) - *ImageFromCam(camera, point);
    EXPECT_LT((moved - expected).norm(), 1e-3) << "terms of second order";
  }
}

INSTANTIATE_TEST_SUITE_P(CameraModels, WithCorrectionsTest,
                         testing::Values("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV",
                                         "FULL_OPENCV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "OPENCV_FISHEYE",
                                         "THIN_PRISM_FISHEYE"));

TEST(CameraProblem, ImpossibleFocalLengthsAreNamed) {
  const int model_id = *CameraModelId("SIMPLE_PINHOLE");
  EXPECT_EQ(CameraProblem({0, model_id, 1000, 600, {1e8, 500, 300}, true}), "");
  EXPECT_EQ(CameraProblem({0, model_id, 1000, 600, {1e10, 500, 300}, true}),
            "the camera's focal length of 1e+10 pixels is impossible for an image of 1000 pixels");
  EXPECT_NE(CameraProblem({0, model_id, uint64_t{1} << 62, 600, {500, 500, 300}, true}), "");
  EXPECT_NE(CameraProblem({0, model_id, 1000, 600, {1e-300, 500, 300}, true}), "");
  EXPECT_EQ(CameraProblem({0, model_id, 1000, 600, {-1, 500, 300}, true}), "the camera's focal length is not positive");
}

TEST(WithCorrections, DistortionIsKept) {
  Camera camera = CameraFromFocalLength(*CameraModelId("RADIAL"), 800, 1000, 600);
  camera.params[3] = -0.1;
  camera.params[4] = 0.02;
  const Camera corrected = WithCorrections(camera, {0, 0}, 0, 0);
  for (const Eigen::Vector3d& point : {Eigen::Vector3d(0.4, 0.1, 1), {-0.2, 0.3, 1}}) {
    EXPECT_LT((*ImageFromCam(corrected, point) - *ImageFromCam(camera, point)).norm(), 1e-9);
  }
}

TEST(WithCorrections, AModelWithoutADistortionOfThisFormKeepsItsOwn) {
  Camera camera = CameraFromFocalLength(*CameraModelId("FOV"), 800, 1000, 600);
  camera.params[4] = 0.9;
  const Camera corrected = WithCorrections(camera, {3, -2}, 0, 1e-8);
  EXPECT_EQ(corrected.model_id, camera.model_id);
  EXPECT_EQ(corrected.params[4], 0.9);
  EXPECT_EQ(corrected.params[2], 503);
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/bridge/camera_models.h"

#include <cmath>
#include <string>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

TEST(CameraProblem, ImpossibleFocalLengthsAreNamed) {
  const int model_id = *CameraModelId("SIMPLE_PINHOLE");
  EXPECT_EQ(CameraProblem({0, model_id, 1000, 600, {1e8, 500, 300}, true}), "");
  EXPECT_EQ(CameraProblem({0, model_id, 1000, 600, {1e10, 500, 300}, true}),
            "the camera's focal length of 1e+10 pixels is impossible for an image of 1000 pixels");
  EXPECT_NE(CameraProblem({0, model_id, uint64_t{1} << 62, 600, {500, 500, 300}, true}), "");
  EXPECT_NE(CameraProblem({0, model_id, 1000, 600, {1e-300, 500, 300}, true}), "");
  EXPECT_EQ(CameraProblem({0, model_id, 1000, 600, {-1, 500, 300}, true}), "the camera's focal length is not positive");
}

}  // namespace
}  // namespace lazyloc

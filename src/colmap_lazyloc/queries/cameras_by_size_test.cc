#include "colmap_lazyloc/queries/cameras_by_size.h"

#include <gmock/gmock.h>

namespace lazyloc {
namespace {

constexpr int kPinhole = 1;  // COLMAP's model id

class CamerasBySizeTest : public ::testing::Test {
 protected:
  // Adds a camera and images with it.
  void Add(uint32_t camera_id, uint64_t width, uint64_t height, int num_images) {
    model_.cameras[camera_id] = {camera_id, kPinhole, width, height, {500, 500, 320, 240}, false};
    for (int i = 0; i < num_images; ++i) {
      ModelImage image;
      image.camera_id = camera_id;
      model_.images.push_back(image);
    }
  }
  // Returns the ids of the cameras with a size.
  std::vector<uint32_t> IdsOfSize(uint64_t width, uint64_t height) const {
    const CamerasBySize cameras(model_, {});
    std::vector<uint32_t> ids;
    for (const DatabaseCamera& camera : cameras.OfSize(width, height)) {
      ids.push_back(camera.camera.camera_id);
    }
    return ids;
  }

  Model model_;
};

TEST_F(CamerasBySizeTest, MostUsedOnesComeFirst) {
  Add(1, 640, 480, 1);
  Add(2, 640, 480, 3);
  Add(3, 480, 640, 2);
  Add(4, 640, 481, 9);
  Add(5, 640, 480, 0);
  EXPECT_THAT(IdsOfSize(640, 480), ::testing::ElementsAre(2, 3, 1)) << "without an image, nothing tells of a camera";
  EXPECT_EQ(IdsOfSize(480, 640), IdsOfSize(640, 480));
  EXPECT_THAT(IdsOfSize(640, 482), ::testing::IsEmpty());
  EXPECT_EQ(CamerasBySize(model_, {}).OfSize(640, 480).front().num_images, 3);
}

TEST_F(CamerasBySizeTest, ThereAreAtMostAThousand) {
  for (uint32_t camera_id = 0; camera_id < 1200; ++camera_id) Add(camera_id, 640, 480, 1);
  EXPECT_EQ(IdsOfSize(640, 480).size(), 1000u);
}

}  // namespace
}  // namespace lazyloc

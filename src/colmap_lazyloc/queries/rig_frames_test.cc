#include "colmap_lazyloc/queries/rig_frames.h"

#include <gmock/gmock.h>

#include "colmap_lazyloc/testing/io_test.h"

namespace lazyloc {
namespace {

using ::testing::HasSubstr;
using ::testing::Pair;
using ::testing::UnorderedElementsAre;

class RigFramesTest : public IoTest {
 protected:
  std::filesystem::path WriteConfig(const std::string& first_prefix, const std::string& second_prefix) const {
    return WriteFile("rigs.json", R"([{"cameras": [{"image_prefix": ")" + first_prefix + R"(", "ref_sensor": true}]},
                                      {"cameras": [{"image_prefix": ")" +
                                      second_prefix + R"(", "ref_sensor": true}]}])");
  }
};

TEST_F(RigFramesTest, FramesOfSeveralRigsHaveDifferentNames) {
  const FramePlaces places = FramesFromConfig({"a/1.png", "b/1.png", "c/1.png"}, WriteConfig("a/", "b/"));
  ASSERT_EQ(places.size(), 2u);
  EXPECT_EQ(places.at("a/1.png").frame_name, "a/1.png");
  EXPECT_EQ(places.at("b/1.png").frame_name, "b/1.png");
  const FramePlaces numbered = FramesFromConfig({"a1.png", "b1.png"}, WriteConfig("a", "b"));
  EXPECT_EQ(numbered.at("a1.png").frame_name, "rig 1: 1.png");
  EXPECT_EQ(numbered.at("b1.png").frame_name, "rig 2: 1.png");
}

TEST_F(RigFramesTest, FrameIsNamedFromTheFolderOfItsCameras) {
  const std::filesystem::path path = WriteFile("rigs.json", R"([{"cameras": [
      {"image_prefix": "query/left/", "ref_sensor": true},
      {"image_prefix": "query/lower/", "cam_from_rig_rotation": [1, 0, 0, 0], "cam_from_rig_translation": [0, 1, 0]}
      ]}])");
  const FramePlaces places = FramesFromConfig({"query/left/1.png", "query/lower/1.png"}, path);
  EXPECT_EQ(places.at("query/left/1.png").frame_name, "query/1.png");
  EXPECT_EQ(places.at("query/lower/1.png").frame_name, "query/1.png");
}

TEST_F(RigFramesTest, ImageOfTwoCamerasIsAnError) {
  const std::filesystem::path path = WriteConfig("a/", "a/b/");
  EXPECT_THAT(ErrorOf([&] { FramesFromConfig({"a/b/1.png"}, path); }),
              HasSubstr("rigs.json: image a/b/1.png matches the image_prefix of two cameras"));
}

TEST_F(RigFramesTest, SharedFramesHaveTwoImagesOrMore) {
  const FramePlaces places = {{"left/1.png", {"1", {}}}, {"right/1.png", {"1", {}}}, {"left/2.png", {"2", {}}}};
  const FramePlaces shared = SharedFrames(places);
  ASSERT_EQ(shared.size(), 2u);
  EXPECT_EQ(shared.at("left/1.png").frame_name, "1");
  EXPECT_EQ(shared.at("right/1.png").frame_name, "1");
}

}  // namespace
}  // namespace lazyloc

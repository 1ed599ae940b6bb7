#include "colmap_lazyloc/queries/query_groups.h"

#include <gmock/gmock.h>

#include "colmap_lazyloc/testing/io_test.h"
#include "colmap_lazyloc/testing/test_database.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr char kConfig[] = R"([{"cameras": [
  {"image_prefix": "left/", "ref_sensor": true},
  {"image_prefix": "right/", "cam_from_rig_rotation": [1, 0, 0, 0], "cam_from_rig_translation": [-0.5, 0, 0]}]}])";

class GroupQueriesTest : public IoTest {
 protected:
  GroupQueriesTest() {
    TestDatabase database(folder_ / "database.db", TestDatabase::Schema::V4_2);
    uint32_t image_id = 1;
    for (const std::string& name : names_) database.AddImage(image_id++, 1, name);
  }

  QueryGroups Group() {
    return GroupQueries({names_.begin(), names_.end()}, DatabaseReader(folder_ / "database.db"), model_, options_);
  }
  std::string Error() {
    return ErrorOf([&] { Group(); });
  }
  // Returns the names of each group, with frames in brackets.
  std::vector<std::string> Described() {
    std::vector<std::string> descriptions;
    const QueryGroups groups = Group();
    for (size_t i = 0; i < groups.Size(); ++i) {
      std::string description;
      for (const QueryFrame& frame : groups.At(i)) {
        description += '[';
        for (const auto& image : frame.images) description.append(" ").append(image.name);
        description += " ]";
      }
      descriptions.push_back(description);
    }
    return descriptions;
  }

  const std::vector<std::string> names_ = {"left/2.png", "right/2.png", "left/1.png", "right/1.png", "3.png"};
  QueryGroupsOptions options_;
  Model model_;
};

TEST_F(GroupQueriesTest, EachForItselfByDefault) {
  EXPECT_THAT(Described(),
              ElementsAre("[ left/2.png ]", "[ right/2.png ]", "[ left/1.png ]", "[ right/1.png ]", "[ 3.png ]"));
}

TEST_F(GroupQueriesTest, RunsOfTheListInItsOrder) {
  options_.group_size = 3;
  EXPECT_THAT(Described(), ElementsAre("[ left/2.png ][ right/2.png ][ left/1.png ]", "[ right/1.png ][ 3.png ]"));
}

TEST_F(GroupQueriesTest, RigConfig) {
  options_.rig_config_path = WriteFile("rigs.json", kConfig);
  EXPECT_THAT(Described(), ElementsAre("[ left/2.png right/2.png ]", "[ left/1.png right/1.png ]", "[ 3.png ]"));
  const QueryFrame frame = Group().At(1)[0];
  EXPECT_EQ(frame.name, "1.png");
  EXPECT_EQ(frame.images[1].cam_from_rig.translation, Eigen::Vector3d(-0.5, 0, 0));
  options_.group_size = 2;
  EXPECT_THAT(Described(), ElementsAre("[ left/2.png right/2.png ][ left/1.png right/1.png ]", "[ 3.png ]"));
  options_.use_rigs = false;
  options_.group_size = 1;
  EXPECT_EQ(Group().Size(), 5);
}

TEST_F(GroupQueriesTest, BadRigConfigs) {
  const std::string two_references = R"([{"cameras": [{"image_prefix": "left/", "ref_sensor": true},
                                                      {"image_prefix": "right/", "ref_sensor": true}]}])";
  const std::string no_pose = R"([{"cameras": [{"image_prefix": "left/", "ref_sensor": true},
                                               {"image_prefix": "right/"}]}])";
  const std::string no_image = R"([{"cameras": [{"image_prefix": "front/", "ref_sensor": true}]}])";
  const std::string no_reference =
      R"([{"cameras": [{"image_prefix": "left/", "cam_from_rig_rotation": [1, 0, 0, 0],
                        "cam_from_rig_translation": [0, 0, 0]}]}])";
  for (const auto& [content, message] : {std::pair{two_references, "camera 'right/': is a second reference sensor"},
                                         std::pair{no_pose, "camera 'right/': has no pose in the rig"},
                                         std::pair{no_image, "no query matches the image_prefix of a camera"},
                                         std::pair{no_reference, "no camera has ref_sensor"},
                                         std::pair{std::string("[{]"), "is not a rig configuration"},
                                         std::pair{std::string("{\"cameras\": 3}"), "is not a rig configuration"}}) {
    options_.rig_config_path = WriteFile("rigs.json", content);
    EXPECT_THAT(Error(), HasSubstr("rigs.json"));
    EXPECT_THAT(Error(), HasSubstr(message)) << content;
  }
  options_.rig_config_path = folder_ / "missing.json";
  EXPECT_THAT(Error(), HasSubstr("missing.json: cannot be read"));
}

TEST_F(GroupQueriesTest, GroupList) {
  options_.group_list_path = WriteFile("groups.txt", "# two\nleft/1.png 3.png\nright/1.png right/2.png\n");
  EXPECT_THAT(Described(), ElementsAre("[ left/1.png ][ 3.png ]", "[ right/1.png ][ right/2.png ]", "[ left/2.png ]"));
}

TEST_F(GroupQueriesTest, BadGroupLists) {
  for (const auto& [content, message] :
       {std::pair{"3.png\n4.png", "groups.txt:2: '4.png' is not a query"},
        std::pair{"3.png left/1.png\n3.png", "groups.txt:2: '3.png' is listed twice"},
        std::pair{"left/1.png\nright/1.png", "groups.txt:2: the frame of 'right/1.png' is already in another group"},
        std::pair{"# none\n", "groups.txt: contains no group"}}) {
    options_.rig_config_path = WriteFile("rigs.json", kConfig);
    options_.group_list_path = WriteFile("groups.txt", content);
    EXPECT_THAT(Error(), HasSubstr(message));
  }
}

TEST_F(GroupQueriesTest, TrajectoryMakesOneFrameAndNamesTheGaps) {
  options_.trajectory_path = WriteFile("trajectory.txt", "left/1.png 1 0 0 0 0 0 1\nleft/2.png 1 0 0 0 0 0 2\n");
  EXPECT_THAT(Described(), ElementsAre("[ left/2.png left/1.png ]", "[ right/2.png ]", "[ right/1.png ]", "[ 3.png ]"));
  EXPECT_THAT(Group().warnings,
              ElementsAre(HasSubstr("no pose for 3 queries (for example right/2.png): localizing them individually")));
  EXPECT_EQ(Group().At(0)[0].images[0].cam_from_rig.translation.z(), 2);
}

TEST_F(GroupQueriesTest, TrajectoryOfTum) {
  // The file has world_from_cam, scalar last.
  options_.trajectory_path = WriteFile("trajectory.txt", "2.5 9 9 9 0 0 0 1\n3.0 1 2 3 0 0 0 1\n");
  const QueryFrame frame = Group().At(0)[0];
  ASSERT_EQ(frame.images.size(), 1);
  EXPECT_EQ(frame.images[0].name, "3.png");
  EXPECT_EQ(frame.images[0].cam_from_rig.translation, Eigen::Vector3d(-1, -2, -3));
}

TEST_F(GroupQueriesTest, BadTrajectories) {
  for (const auto& [content, message] :
       {std::pair{"4.png 1 0 0 0 0 0 1\n", "no pose for any query (for example left/2.png)"},
        std::pair{"3.png 1 0 0 0 0 0\n", "trajectory.txt:1: the line ends too early"},
        std::pair{"3.png 0 0 0 0 0 0 1\n", "trajectory.txt:1: the pose is not a unit quaternion"},
        std::pair{"3.png 1 0 0 0 0 0 1\n3.png 1 0 0 0 0 0 1\n", "trajectory.txt:2: a second pose of 3.png"},
        std::pair{"1.0 0 0 0 0 0 0 1\n", "trajectory.txt:1: both left/1.png and right/1.png have this timestamp"}}) {
    options_.trajectory_path = WriteFile("trajectory.txt", content);
    EXPECT_THAT(Error(), HasSubstr(message));
  }
}

TEST_F(GroupQueriesTest, RigsOfTheDatabase) {
  TestDatabase database(folder_ / "rigs.db", TestDatabase::Schema::V4_2);
  for (uint32_t i = 0; i < 4; ++i) database.AddImage(i + 1, i % 2 + 1, names_[i]);
  for (const char* table : {"rigs(rig_id, ref_sensor_id, ref_sensor_type)", "frames(frame_id, rig_id)",
                            "rig_sensors(rig_id, sensor_id, sensor_type, sensor_from_rig)",
                            "frame_data(frame_id, data_id, sensor_id, sensor_type)"}) {
    database.Execute(std::string("CREATE TABLE IF NOT EXISTS ") + table);
  }
  // The blob is 1, 0, 0, 0, -0.5, 0, 0 as little-endian doubles.
  database.Execute(
      "INSERT INTO rigs VALUES(7, 1, 0); INSERT INTO frames VALUES(70, 7), (71, 7);"
      "INSERT INTO rig_sensors VALUES(7, 2, 0, x'000000000000f03f000000000000000000000000000000000000000000000000"
      "000000000000e0bf00000000000000000000000000000000');"
      "INSERT INTO frame_data VALUES(70, 1, 1, 0), (70, 2, 2, 0), (71, 3, 1, 0), (71, 4, 2, 0), (71, 4, 9, 1)");
  const QueryGroups grouped =
      GroupQueries({names_.begin(), names_.end()}, DatabaseReader(folder_ / "rigs.db"), model_, options_);
  ASSERT_EQ(grouped.Size(), 3);
  ASSERT_EQ(grouped.At(0)[0].images.size(), 2);
  EXPECT_EQ(grouped.At(0)[0].images[1].name, "right/2.png");
  EXPECT_EQ(grouped.At(0)[0].images[1].cam_from_rig.translation, Eigen::Vector3d(-0.5, 0, 0));
  EXPECT_THAT(grouped.warnings, IsEmpty());
  database.Execute("UPDATE rig_sensors SET sensor_from_rig = NULL");
  const QueryGroups uncalibrated =
      GroupQueries({names_.begin(), names_.end()}, DatabaseReader(folder_ / "rigs.db"), model_, options_);
  EXPECT_EQ(uncalibrated.Size(), 5);
  EXPECT_THAT(uncalibrated.warnings,
              ElementsAre(HasSubstr("no pose in the rig for the cameras of 2 queries (for example right/2.png)")));
  database.Execute("UPDATE rig_sensors SET sensor_from_rig = x'00'");
  const QueryGroups damaged =
      GroupQueries({names_.begin(), names_.end()}, DatabaseReader(folder_ / "rigs.db"), model_, options_);
  EXPECT_EQ(damaged.Size(), 5);
  EXPECT_THAT(damaged.warnings,
              ElementsAre(HasSubstr("rigs.db: table frame_data, image 2 (right/2.png): sensor_from_rig has 1 bytes"),
                          HasSubstr("image 4 (right/1.png)")));
}

TEST_F(GroupQueriesTest, RigsOfTheModel) {
  const Sensor left{SensorType::CAMERA, 1}, right{SensorType::CAMERA, 2};
  const Rigid3d right_from_left{Eigen::Quaterniond::Identity(), {-0.5, 0, 0}};
  model_.rigs[7] = {7, left, {{right, right_from_left}}};
  model_.images = {{11, 1, "left/2.png", {}}, {12, 2, "right/2.png", {}}, {13, 1, "left/1.png", {}}};
  model_.frames[70] = {70, 7, {}, {{left, 11}, {right, 12}}};
  model_.frames[71] = {71, 7, {}, {{left, 13}, {right, 14}}};  // only one of them is in the model
  EXPECT_THAT(Described(), ElementsAre("[ left/2.png right/2.png ]", "[ left/1.png ]", "[ right/1.png ]", "[ 3.png ]"));
  EXPECT_EQ(Group().At(0)[0].images[1].cam_from_rig.translation, right_from_left.translation);
  options_.use_rigs = false;
  EXPECT_EQ(Group().Size(), 5u);
}

}  // namespace
}  // namespace lazyloc

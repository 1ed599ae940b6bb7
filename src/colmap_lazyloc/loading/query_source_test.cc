#include "colmap_lazyloc/loading/query_source.h"

#include <gmock/gmock.h>

#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/testing/io_test.h"
#include "colmap_lazyloc/testing/random_descriptors.h"
#include "colmap_lazyloc/testing/test_database.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

constexpr int kNumKeypoints = 10;
constexpr uint32_t kQuery = 5, kSecondQuery = 6;  // ids in the database
// The relative pose of two cameras without rotation, 0.5 apart, as little-endian doubles: 1, 0, 0, 0, -0.5, 0, 0.
constexpr char kRightFromLeft[] =
    "x'000000000000f03f000000000000000000000000000000000000000000000000"
    "000000000000e0bf00000000000000000000000000000000'";

Matches MakeMatches(uint32_t num_matches) {
  Matches matches;
  for (uint32_t i = 0; i < num_matches; ++i) matches.push_back({i, i});
  return matches;
}

// Posed images left/1.png to right/2.png (ids 1 to 4), and queries q.png and r.png. q.png has three inliers with the
// first image, four with the second, two with the third, and five raw matches with the fourth.
class QuerySourceTest : public IoTest {
 protected:
  QuerySourceTest() {
    database_.AddCamera({1, /*model_id=*/0, 640, 480, {500, 320, 240}, false});
    const char* names[] = {"left/1.png", "right/1.png", "left/2.png", "right/2.png", "q.png", "r.png"};
    for (uint32_t id = 1; id <= 6; ++id) {
      database_.AddImage(id, 1, names[id - 1]);
      database_.AddKeypoints(id, std::vector<Eigen::Vector2d>(kNumKeypoints, {10.0 * id, 5}));
    }
    for (const auto& [id, num_inliers] : {std::pair{1, 3}, {2, 4}, {3, 2}}) AddGeometry(kQuery, id, num_inliers);
    database_.AddMatches(kQuery, 4, MakeMatches(5));
    WriteFile("cameras.txt", "1 SIMPLE_PINHOLE 640 480 500 320 240\n");
    WriteFile("images.txt",
              "1 1 0 0 0 1 0 0 1 left/1.png\n\n2 1 0 0 0 2 0 0 1 right/1.png\n\n"
              "3 1 0 0 0 3 0 0 1 left/2.png\n\n4 1 0 0 0 4 0 0 1 right/2.png\n\n");
    options_.database_path = folder_ / "database.db";
    options_.input_path = folder_;
  }

  void AddGeometry(uint32_t query_id, uint32_t other_id, uint32_t num_inliers) {
    TwoViewGeometry geometry;
    geometry.config = TwoViewConfig::CALIBRATED;
    geometry.inlier_matches = MakeMatches(num_inliers);
    database_.AddTwoViewGeometry(query_id, other_id, geometry);
    database_.AddMatches(query_id, other_id, MakeMatches(num_inliers + 1));
  }
  void SetQueries(const std::string& list) { options_.selection.query_list_path = WriteFile("queries.txt", list); }

  LoadedGroup Load(size_t group = 0) const {
    const QuerySource source(options_, ReadModel(options_.input_path), /*seed=*/0, /*num_threads=*/1);
    IdleThreads idle_threads(0);
    QuerySource::Session session(source, &idle_threads);
    return source.Load(source.Group(group), source.FirstAttempt(), nullptr, &session);
  }
  std::string Error() const {
    return ErrorOf([&] { Load(); });
  }
  static std::vector<std::string> PairNames(const LoadedGroup& loaded, size_t image = 0) {
    std::vector<std::string> names;
    for (const ImagePair& pair : loaded.group.images.at(image).problem.pairs) names.push_back(pair.other_name);
    return names;
  }
  std::vector<std::string> FrameNames() const {
    std::vector<std::string> names;
    const LoadedGroup loaded = Load();
    for (const ImagePair& pair : loaded.group.images.at(0).problem.pairs) names.push_back(pair.database_frame_name);
    return names;
  }

  TestDatabase database_{folder_ / "database.db", TestDatabase::Schema::V4_2};
  SourceOptions options_;
};

TEST_F(QuerySourceTest, LoadsAQueryWithItsPairs) {
  const LoadedGroup loaded = Load();
  ASSERT_EQ(loaded.group.images.size(), 1u);
  EXPECT_THAT(loaded.group.frame_names, ElementsAre(""));
  const LocalizationProblem& problem = loaded.group.images[0].problem;
  EXPECT_EQ(problem.query_name, "q.png");
  EXPECT_EQ(problem.query_keypoints.size(), size_t{kNumKeypoints});
  EXPECT_EQ(problem.query_camera.params, (std::vector<double>{500, 320, 240}));
  EXPECT_THAT(PairNames(loaded), ElementsAre("left/1.png", "left/2.png", "right/1.png", "right/2.png"));
  const ImagePair& pair = problem.pairs[2];
  EXPECT_EQ(pair.database_cam_from_world.translation.x(), 2);
  EXPECT_EQ(pair.other_keypoints[0].x(), 20);
  EXPECT_EQ(pair.geometry->inlier_matches, MakeMatches(4));
  EXPECT_THAT(pair.matches, IsEmpty());
  EXPECT_FALSE(problem.pairs[3].geometry.has_value());
  EXPECT_EQ(problem.pairs[3].matches, MakeMatches(5));
  ASSERT_EQ(loaded.records.size(), 1u);
  EXPECT_THAT(loaded.records[0].seconds, ElementsAre(::testing::Pair("load", ::testing::Ge(0))));
  EXPECT_THAT(loaded.records[0].keypoints, IsEmpty()) << "they are in the database";
}

TEST_F(QuerySourceTest, KeepsThePairsWithTheMostInliers) {
  options_.num_retrieved = 2;
  EXPECT_THAT(PairNames(Load()), ElementsAre("left/1.png", "right/1.png"));
  EXPECT_EQ(Load().group.images[0].problem.max_num_pairs, 2);
}

TEST_F(QuerySourceTest, LoadsTwiceAsManyUnverifiedPairsAsAreMissing) {
  options_.num_retrieved = 1;
  database_.Execute("DELETE FROM two_view_geometries");
  EXPECT_THAT(PairNames(Load()), ElementsAre("right/1.png", "right/2.png"));
}

TEST_F(QuerySourceTest, PairsFileReplacesRetrieval) {
  options_.num_retrieved = 1;
  options_.selection.pairs_path = WriteFile("pairs.txt", "q.png right/2.png\nleft/2.png q.png\nq.png x\nq.png r.png\n");
  EXPECT_THAT(PairNames(Load()), ElementsAre("left/2.png", "right/2.png"));
  const QuerySource source(options_, ReadModel(options_.input_path), 0, 1);
  EXPECT_EQ(Load().group.images[0].problem.max_num_pairs, 0) << "all of them are used";
  EXPECT_THAT(source.Warnings(),
              ElementsAre(HasSubstr("ignoring images that are not in the database: 1, for example x")));
  options_.selection.pairs_path = WriteFile("pairs.txt", "q.png q.png\nx y\n");
  EXPECT_THAT(PairNames(Load()), IsEmpty());
  options_.selection.pairs_path = WriteFile("pairs.txt", "y x\n");
  EXPECT_THAT(ErrorOf([&] { Load(); }), StartsWith("pairs.txt: none of its images is in the database (for example x)"));
}

TEST_F(QuerySourceTest, OtherIntrinsicsMakeAGeometryUncalibrated) {
  SetQueries("q.png SIMPLE_PINHOLE 640 480 510 320 240\n");
  const LoadedGroup loaded = Load();
  const ImagePair& pair = loaded.group.images[0].problem.pairs[0];
  EXPECT_EQ(pair.geometry->config, TwoViewConfig::UNCALIBRATED);
  EXPECT_FALSE(pair.geometry->E.has_value()) << "of the other intrinsics";
  EXPECT_FALSE(pair.geometry->query_from_other.has_value());
  EXPECT_FALSE(pair.geometry->inlier_matches.empty()) << "from which it is estimated again";
}

TEST_F(QuerySourceTest, GroupHasThePairsAmongItsQueries) {
  AddGeometry(kSecondQuery, kQuery, 6);
  options_.selection.groups.group_size = 2;
  const LoadedGroup loaded = Load();
  ASSERT_EQ(loaded.group.images.size(), 2u);
  ASSERT_EQ(loaded.group.query_pairs.size(), 1u);
  const QueryPair& pair = loaded.group.query_pairs[0];
  EXPECT_EQ(loaded.group.images[pair.query].problem.query_name, "r.png");
  EXPECT_EQ(loaded.group.images[pair.other].problem.query_name, "q.png");
  EXPECT_EQ(pair.images.other_name, "q.png");
  EXPECT_EQ(pair.images.geometry->inlier_matches.size(), 6u);
}

TEST_F(QuerySourceTest, LeaveOneOutLeavesOutTheWholeGroup) {
  for (const uint32_t other : {1, 2, 3}) AddGeometry(4, other, 5);
  options_.selection.leave_one_out = true;
  SetQueries("right/2.png\nleft/2.png\n");
  EXPECT_THAT(PairNames(Load()), ElementsAre("left/1.png", "left/2.png", "right/1.png"));
  options_.selection.groups.group_size = 2;
  EXPECT_THAT(PairNames(Load()), ElementsAre("left/1.png", "right/1.png"));
  EXPECT_EQ(QuerySource(options_, ReadModel(options_.input_path), 0, 1).DatabaseModel().images.size(), 4u);
}

TEST_F(QuerySourceTest, ListedQueryIsNotADatabaseImage) {
  SetQueries("q.png\nright/1.png\n");
  EXPECT_THAT(PairNames(Load()), ElementsAre("left/1.png", "left/2.png", "right/2.png"));
}

TEST_F(QuerySourceTest, MatchesOfMissingKeypointsAreLeftOut) {
  database_.Execute("DELETE FROM keypoints WHERE image_id = 2");
  const LoadedGroup loaded = Load();
  EXPECT_THAT(PairNames(loaded), ElementsAre("left/1.png", "left/2.png", "right/2.png"));
  EXPECT_THAT(loaded.records.at(0).damages,
              ElementsAre("table two_view_geometries, pair of q.png and right/1.png: a match names a keypoint that its "
                          "image does not have"));
}

TEST_F(QuerySourceTest, DamagedPairsAreLeftOutAndOthersTakeTheirPlace) {
  options_.num_retrieved = 2;
  const std::string geometry_of_2 = "pair_id = 2 * 2147483647 + " + std::to_string(kQuery);
  database_.Execute("UPDATE two_view_geometries SET data = x'00' WHERE " + geometry_of_2);
  database_.Execute("UPDATE keypoints SET rows = -1 WHERE image_id = 1");
  const LoadedGroup loaded = Load();
  EXPECT_THAT(PairNames(loaded), ElementsAre("left/2.png", "right/2.png"));
  EXPECT_THAT(loaded.records.at(0).damages,
              ElementsAre(HasSubstr("pair of image 5 (q.png) and image 2 (right/1.png): data has 1 bytes"),
                          "table keypoints, image 1 (left/1.png): rows is out of range: -1"));
}

TEST_F(QuerySourceTest, DamagedRecordsOfAQueryAreItsStatusAndTheOthersStay) {
  options_.selection.groups.group_size = 2;
  database_.AddCamera({2, /*model_id=*/99, 640, 480, {500, 320, 240}, false});
  for (const auto& [sql, damage] :
       {std::pair{"UPDATE keypoints SET rows = 7 WHERE image_id = 5", "table keypoints, image 5 (q.png): data has"},
        std::pair{"UPDATE images SET camera_id = 2 WHERE image_id = 5",
                  "table cameras, camera 2: unknown camera model 99"},
        std::pair{"UPDATE images SET camera_id = 'x' WHERE image_id = 5",
                  "table images, image 5: camera_id is not an integer"}}) {
    database_.Execute(sql);
    const LoadedGroup loaded = Load();
    ASSERT_EQ(loaded.refused.size(), 1u) << sql;
    EXPECT_EQ(loaded.refused[0].record.result.query_name, "q.png");
    EXPECT_EQ(loaded.refused[0].refusal.status, QueryStatus::DAMAGED_DATA);
    EXPECT_THAT(loaded.refused[0].refusal.reason, ::testing::StartsWith(damage));
    ASSERT_EQ(loaded.group.images.size(), 1u);
    EXPECT_EQ(loaded.group.images[0].problem.query_name, "r.png");
  }
}

TEST_F(QuerySourceTest, ListedQueryMayBeTheImageWhoseNameCannotBeRead) {
  database_.Execute("UPDATE images SET name = x'00' WHERE image_id = 5");
  SetQueries("q.png\n");
  const LoadedGroup loaded = Load();
  ASSERT_EQ(loaded.refused.size(), 1u);
  EXPECT_EQ(loaded.refused[0].refusal.reason, "table images, image 5: name is not text");
}

TEST_F(QuerySourceTest, DamagedPairOfTwoQueriesIsLeftOut) {
  options_.selection.groups.group_size = 2;
  AddGeometry(6, kQuery, 3);
  ASSERT_EQ(Load().group.query_pairs.size(), 1u);
  database_.Execute("UPDATE two_view_geometries SET rows = 'x' WHERE pair_id = 5 * 2147483647 + 6");
  const LoadedGroup loaded = Load();
  EXPECT_THAT(loaded.group.query_pairs, IsEmpty());
  EXPECT_THAT(loaded.records.at(0).damages, IsEmpty());
  EXPECT_THAT(loaded.records.at(1).damages,
              ElementsAre(HasSubstr("pair of image 6 (r.png) and image 5 (q.png): rows is not an integer")));
}

TEST_F(QuerySourceTest, DatabaseImagesHaveNoFrameWithoutRigs) {
  EXPECT_THAT(FrameNames(), ElementsAre("", "", "", ""));
}

TEST_F(QuerySourceTest, DatabaseImagesHaveTheFramesOfARigConfiguration) {
  options_.selection.groups.rig_config_path = WriteFile("rigs.json", R"([{"cameras": [
    {"image_prefix": "left/", "ref_sensor": true},
    {"image_prefix": "right/", "cam_from_rig_rotation": [1, 0, 0, 0], "cam_from_rig_translation": [-0.5, 0, 0]},
    {"image_prefix": "q", "cam_from_rig_rotation": [1, 0, 0, 0], "cam_from_rig_translation": [-1, 0, 0]}]}])");
  EXPECT_THAT(FrameNames(), ElementsAre("1.png", "2.png", "1.png", "2.png"));
  SetQueries("q.png\nright/2.png\n");
  EXPECT_THAT(FrameNames(), ElementsAre("1.png", "", "1.png")) << "left/2.png is alone";
  options_.selection.groups.use_rigs = false;
  EXPECT_THAT(FrameNames(), ElementsAre("", "", ""));
}

TEST_F(QuerySourceTest, DatabaseImagesHaveTheFramesOfTheModel) {
  WriteFile("cameras.txt", "1 SIMPLE_PINHOLE 640 480 500 320 240\n2 SIMPLE_PINHOLE 640 480 500 320 240\n");
  WriteFile("images.txt",
            "1 1 0 0 0 1 0 0 1 left/1.png\n\n2 1 0 0 0 2 0 0 2 right/1.png\n\n3 1 0 0 0 3 0 0 1 left/2.png\n\n");
  WriteFile("rigs.txt", "7 2 CAMERA 1 CAMERA 2 1 1 0 0 0 -0.5 0 0\n");
  WriteFile("frames.txt", "70 7 1 0 0 0 1 0 0 2 CAMERA 1 1 CAMERA 2 2\n71 7 1 0 0 0 3 0 0 1 CAMERA 1 3\n");
  SetQueries("q.png\n");
  EXPECT_THAT(PairNames(Load()), ElementsAre("left/1.png", "left/2.png", "right/1.png"));
  EXPECT_THAT(FrameNames(), ElementsAre("model's 70", "", "model's 70"));
}

TEST_F(QuerySourceTest, DatabaseImagesHaveTheFramesOfTheDatabase) {
  for (const char* table : {"rigs(rig_id, ref_sensor_id, ref_sensor_type)", "frames(frame_id, rig_id)",
                            "rig_sensors(rig_id, sensor_id, sensor_type, sensor_from_rig)",
                            "frame_data(frame_id, data_id, sensor_id, sensor_type)"}) {
    database_.Execute(std::string("CREATE TABLE IF NOT EXISTS ") + table);
  }
  database_.Execute(std::string("INSERT INTO rigs VALUES(7, 1, 0); INSERT INTO frames VALUES(70, 7), (71, 7);"
                                "INSERT INTO rig_sensors VALUES(7, 2, 0, ") +
                    kRightFromLeft +
                    "); INSERT INTO frame_data VALUES(70, 1, 1, 0), (70, 2, 2, 0), (71, 3, 1, 0), (71, 4, 2, 0)");
  EXPECT_THAT(FrameNames(), ElementsAre("70", "71", "70", "71"));
  SetQueries("q.png\nright/2.png\n");
  EXPECT_THAT(FrameNames(), ElementsAre("70", "", "70"));
}

TEST_F(QuerySourceTest, PhotoThatCannotBeReadIsAFailureAndTheOthersStay) {
  database_.AddDescriptors(1, RandomDescriptors(kNumKeypoints, 1));
  WriteFile("photo.jpg", "not an image");
  SetQueries("photo.jpg\nq.png\n");
  options_.photos.image_path = folder_;
  options_.selection.groups.group_size = 2;
  const LoadedGroup loaded = Load();
  ASSERT_EQ(loaded.refused.size(), 1u);
  EXPECT_EQ(loaded.refused[0].record.result.query_name, "photo.jpg");
  EXPECT_EQ(loaded.refused[0].refusal.status, QueryStatus::UNREADABLE_IMAGE);
  EXPECT_THAT(loaded.refused[0].refusal.reason, HasSubstr("photo.jpg does not exist or is not a readable image"));
  EXPECT_THAT(loaded.refused[0].record.seconds, ElementsAre(::testing::Pair("extraction", ::testing::Ge(0))));
  ASSERT_EQ(loaded.group.images.size(), 1u);
  EXPECT_EQ(loaded.records[0].result.query_name, "q.png");
}

TEST_F(QuerySourceTest, QueriesByValueNeedNoQueryInTheFiles) {
  SetQueries("q.png\n");
  options_.selection.has_more_queries = true;
  const QuerySource source(options_, ReadModel(options_.input_path), 0, 1);
  EXPECT_EQ(source.Selection().FindGroup("q.png"), std::make_optional<size_t>(0));
  EXPECT_EQ(source.Selection().FindGroup("r.png"), std::nullopt);
  IdleThreads idle_threads(0);
  QuerySource::Session session(source, &idle_threads);
  LocalizationProblem own;
  own.query_name = "own.png";
  GroupInput input;
  input.frames = {{"frame", {{QueryInput("q.png"), {}}, {QueryInput(own), {}}}}};
  const LoadedGroup loaded = source.Load(input, source.FirstAttempt(), nullptr, &session);
  EXPECT_THAT(loaded.group.frame_names, ElementsAre("frame"));
  ASSERT_EQ(loaded.group.images.size(), 2u);
  EXPECT_THAT(PairNames(loaded), ElementsAre("left/1.png", "left/2.png", "right/1.png", "right/2.png"));
  EXPECT_EQ(loaded.group.images[1].problem.query_name, "own.png");
}

TEST_F(QuerySourceTest, PhotosNeedDescriptorsInTheDatabase) {
  SetQueries("photo.jpg\n");
  options_.photos.image_path = folder_;
  EXPECT_THAT(Error(), HasSubstr("no posed image has descriptors"));
}

TEST(SourceOptions, CheckNamesTheOption) {
  SourceOptions options;
  std::string error;
  EXPECT_TRUE(options.Check(&error));
  options.photos.matches_output_path = "kept.db";
  EXPECT_FALSE(options.photos.CheckImagePath(&error));
  EXPECT_EQ(error, "matches_output_path needs --image_path, because it is for photos");
  options.photos.image_path = "photos";
  EXPECT_TRUE(options.photos.CheckImagePath(&error));
  EXPECT_TRUE(options.Check(&error));
  options.selection.leave_one_out = true;
  EXPECT_FALSE(options.Check(&error));
  EXPECT_THAT(error, ::testing::StartsWith("image_path excludes --LazyLocalizer.leave_one_out"));
  options.num_retrieved = 0;
  EXPECT_FALSE(options.Check(&error));
  EXPECT_EQ(error, "num_retrieved must be >= 1, but is 0");
}

}  // namespace
}  // namespace lazyloc

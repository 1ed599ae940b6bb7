#include "colmap_lazyloc/loading/database_neighbours.h"

#include <gmock/gmock.h>

#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/loading/query_source.h"
#include "colmap_lazyloc/testing/io_test.h"
#include "colmap_lazyloc/testing/test_database.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::UnorderedElementsAre;

constexpr uint32_t kNumImages = 10, kQuery = 11;

// Posed images 1.png to 10.png, all matched with each other; the query q.png has 320 matches with 1.png, 310 with 2.png
// and 300 with 3.png. Image i has its keypoints at x = i.
class DatabaseNeighboursTest : public IoTest {
 protected:
  DatabaseNeighboursTest() {
    database_.AddCamera({1, /*model_id=*/0, 640, 480, {500, 320, 240}, false});
    std::string images;
    for (uint32_t id = 1; id <= kNumImages + 1; ++id) {
      const std::string name = id == kQuery ? "q.png" : std::to_string(id) + ".png";
      database_.AddImage(id, 1, name);
      database_.AddKeypoints(id, std::vector<Eigen::Vector2d>(500, {1.0 * id, 5}));
      for (uint32_t other = 1; other < id && id <= kNumImages; ++other) AddPair(id, other, 100 - id - other);
      if (id <= kNumImages) images += std::to_string(id) + " 1 0 0 0 " + std::to_string(id) + " 0 0 1 " + name + "\n\n";
    }
    for (const uint32_t id : {1, 2, 3}) AddPair(kQuery, id, 330 - 10 * id);
    WriteFile("cameras.txt", "1 SIMPLE_PINHOLE 640 480 500 320 240\n");
    WriteFile("images.txt", images);
    options_.database_path = folder_ / "database.db";
    options_.input_path = folder_;
    options_.num_retrieved = 1;
  }

  void AddPair(uint32_t id, uint32_t other, uint32_t num_inliers) {
    TwoViewGeometry geometry;
    geometry.config = TwoViewConfig::CALIBRATED;
    for (uint32_t i = 0; i < num_inliers; ++i) geometry.inlier_matches.push_back({i, i});
    database_.AddTwoViewGeometry(id, other, geometry);
  }

  // Returns the query's pairs.
  std::vector<ImagePair> Load(size_t group = 0) const {
    const QuerySource source(options_, ReadModel(options_.input_path), /*seed=*/0, /*num_threads=*/1);
    IdleThreads idle_threads(0);
    QuerySource::Session session(source, &idle_threads);
    return source.Load(source.Group(group), source.FirstAttempt(), nullptr, &session).group.images.at(0).problem.pairs;
  }
  // Returns the ids of the neighbours of a pair's database image.
  static std::vector<double> Ids(const ImagePair& pair) {
    std::vector<double> ids;
    for (const NeighbourPair& neighbour : pair.neighbours) {
      ids.push_back(neighbour.other_points.at(0).x());
      EXPECT_EQ(neighbour.cam_from_world.translation.x(), ids.back());
      EXPECT_EQ(neighbour.points.size(), neighbour.other_points.size());
    }
    return ids;
  }

  TestDatabase database_{folder_ / "database.db", TestDatabase::Schema::V4_2};
  SourceOptions options_;
};

TEST_F(DatabaseNeighboursTest, AreThoseWithTheMostMatches) {
  const std::vector<ImagePair> pairs = Load();
  ASSERT_EQ(pairs.size(), 1u);
  EXPECT_THAT(Ids(pairs[0]), ElementsAre(2, 3, 4, 5, 6, 7));
  EXPECT_EQ(pairs[0].neighbours[0].points.size(), 97u);
  EXPECT_EQ(pairs[0].neighbours[0].points[0].x(), 1);
}

TEST_F(DatabaseNeighboursTest, AreLoadedForOneOrTwoDatabaseImages) {
  options_.num_retrieved = 2;
  for (const ImagePair& pair : Load()) EXPECT_EQ(pair.neighbours.size(), 6u);
  options_.num_retrieved = 20;
  for (const ImagePair& pair : Load()) EXPECT_THAT(pair.neighbours, IsEmpty());
  database_.Execute("UPDATE two_view_geometries SET rows = 14, data = substr(data, 1, 112) WHERE rows = 300");
  int num_with_neighbours = 0;
  for (const ImagePair& pair : Load()) num_with_neighbours += pair.neighbours.empty() ? 0 : 1;
  EXPECT_EQ(num_with_neighbours, 2) << "the third image has too few matches to count";
}

TEST_F(DatabaseNeighboursTest, AreLoadedForFewKeypointsThatTwoDatabaseImagesMatch) {
  options_.num_retrieved = 20;
  database_.Execute("UPDATE two_view_geometries SET rows = 199, data = substr(data, 1, 1592) WHERE rows IN (300, 310)");
  for (const ImagePair& pair : Load()) EXPECT_EQ(pair.neighbours.size(), 6u);
}

TEST_F(DatabaseNeighboursTest, AreNotLoadedIfNobodyNeedsThem) {
  options_.reads_database_pairs = false;
  EXPECT_THAT(Load().at(0).neighbours, IsEmpty());
}

TEST_F(DatabaseNeighboursTest, ManyMatchesAreThinnedOut) {
  database_.Execute("DELETE FROM two_view_geometries WHERE rows = 97");
  AddPair(1, 2, 450);
  const ImagePair pair = Load().at(0);
  EXPECT_EQ(Ids(pair).front(), 2);
  EXPECT_EQ(pair.neighbours[0].points.size(), 200u);
}

TEST_F(DatabaseNeighboursTest, QueryTakesNoPart) {
  options_.selection.leave_one_out = true;
  const std::vector<ImagePair> pairs = Load(/*group=*/0);  // of 1.png
  ASSERT_EQ(pairs.size(), 1u);
  EXPECT_EQ(pairs[0].other_name, "2.png");
  EXPECT_THAT(Ids(pairs[0]), UnorderedElementsAre(3, 4, 5, 6, 7, 8));
}

TEST_F(DatabaseNeighboursTest, DamagedRecordsAreLeftOut) {
  database_.Execute("UPDATE two_view_geometries SET data = x'0102' WHERE rows = 97");
  EXPECT_THAT(Ids(Load().at(0)), ElementsAre(3, 4, 5, 6, 7));
  database_.Execute("UPDATE keypoints SET data = x'01' WHERE image_id = 3");
  EXPECT_THAT(Ids(Load().at(0)), ElementsAre(4, 5, 6, 7));
  database_.Execute("UPDATE keypoints SET rows = 2, data = substr(data, 1, 8 * cols) WHERE image_id = 4");
  EXPECT_THAT(Ids(Load().at(0)), ElementsAre(5, 6, 7)) << "matches name keypoints that are missing";
}

TEST_F(DatabaseNeighboursTest, NoneWithoutPairsOfTheDatabase) {
  database_.Execute("DELETE FROM two_view_geometries WHERE rows < 100");
  EXPECT_THAT(Load().at(0).neighbours, IsEmpty());
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/database/database_reader.h"

#include <cstdlib>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/LU>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/testing/test_database.h"
#include "colmap_lazyloc/testing/test_folder.h"

namespace lazyloc {
namespace {

using ::testing::IsEmpty;
using ::testing::ThrowsMessage;
using ::testing::UnorderedElementsAre;
using Schema = TestDatabase::Schema;

using Counts = std::vector<std::pair<uint32_t, int>>;
Counts AsCounts(const std::vector<PairSize>& sizes) {
  Counts counts;
  for (const PairSize& size : sizes) counts.emplace_back(size.image_id, size.num_matches);
  return counts;
}

Camera TestCamera(uint32_t camera_id) {
  Camera camera;
  camera.camera_id = camera_id;
  camera.model_id = 2;
  camera.width = 640;
  camera.height = 480;
  camera.params = {500.5, 320, 240.25, -0.01};
  camera.has_prior_focal_length = true;
  return camera;
}

Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& v) {
  return (Eigen::Matrix3d() << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0).finished();
}

// Makes a pair that looks at a plane, with E, F and H of its pose.
TwoViewGeometry TestGeometry() {
  TwoViewGeometry geometry;
  geometry.config = TwoViewConfig::PLANAR;
  geometry.inlier_matches = {{0, 9}, {1, 4}, {2, 4}, {7, 0}};
  const Eigen::Quaterniond rotation(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, -2, 0.3).normalized()));
  const Eigen::Vector3d translation = Eigen::Vector3d(0.3, -0.2, 0.9).normalized();
  geometry.query_from_other = Rigid3d{rotation, translation};
  const Eigen::Matrix3d K = (Eigen::Matrix3d() << 500, 0, 320, 0, 510, 240, 0, 0, 1).finished();
  geometry.E = CrossMatrix(translation) * rotation.toRotationMatrix();
  geometry.F = K.inverse().transpose() * *geometry.E * K.inverse();
  geometry.H = K * (rotation.toRotationMatrix() + translation * Eigen::RowVector3d(0, 0.1, 0.5)) * K.inverse();
  return geometry;
}

class DatabaseReaderTest : public ::testing::TestWithParam<Schema> {
 protected:
  bool HasPoses() const { return GetParam() != Schema::V3_6; }
  std::filesystem::path Path() const { return folder_ / "database.db"; }

  TestFolder folder_;
  TestDatabase database_{folder_ / "database.db", GetParam()};
};

std::string SchemaName(const ::testing::TestParamInfo<Schema>& info) {
  const char* names[] = {"V3_6", "V3_8", "V3_10", "V4_2"};
  return names[static_cast<int>(info.param)];
}
INSTANTIATE_TEST_SUITE_P(AllSchemas, DatabaseReaderTest,
                         ::testing::Values(Schema::V3_6, Schema::V3_8, Schema::V3_10, Schema::V4_2), SchemaName);

TEST_P(DatabaseReaderTest, EmptyDatabaseHasNothing) {
  const DatabaseReader reader(Path());
  EXPECT_EQ(reader.Path(), Path());
  EXPECT_THAT(reader.ReadImages(), IsEmpty());
  EXPECT_THAT(reader.ReadKeypoints(1), IsEmpty());
  EXPECT_THAT(reader.ReadKeypointsOnce(1), IsEmpty());
  EXPECT_THAT(reader.ReadInlierCounts(1, {2}), IsEmpty());
  EXPECT_THAT(reader.ReadMatchCounts(1, {2}), IsEmpty());
  EXPECT_THAT(reader.ReadMatches(1, 2), IsEmpty());
  EXPECT_FALSE(reader.ReadTwoViewGeometry(1, 2));
}

TEST_P(DatabaseReaderTest, ImagesAreSortedByName) {
  database_.AddImage(1, 4000000000u, "b/\xC3\xA4.jpg");
  database_.AddImage(2147483646, 1, "B.jpg");
  database_.AddImage(7, 2, "a 1.jpg");
  const std::vector<DatabaseImage> images = DatabaseReader(Path()).ReadImages();
  ASSERT_EQ(images.size(), 3u);
  EXPECT_EQ(images[0].image_id, 2147483646u);
  EXPECT_EQ(images[1].name, "a 1.jpg");
  EXPECT_EQ(images[1].camera_id, 2u);
  EXPECT_EQ(images[2].name, "b/\xC3\xA4.jpg");
  EXPECT_EQ(images[2].camera_id, 4000000000u);
}

TEST_P(DatabaseReaderTest, CameraRoundTrip) {
  const Camera camera = TestCamera(12);
  database_.AddCamera(camera);
  const Camera read = DatabaseReader(Path()).ReadCamera(12);
  EXPECT_EQ(read.camera_id, 12u);
  EXPECT_TRUE(SameIntrinsics(read, camera));
  EXPECT_TRUE(read.has_prior_focal_length);
}

TEST_P(DatabaseReaderTest, KeypointsOfAnyNumberOfColumns) {
  const std::vector<Eigen::Vector2d> keypoints = {{0.5, 1.25}, {639.5, 479.75}, {-3, 1e6}};
  for (const int num_cols : {2, 4, 6}) database_.AddKeypoints(num_cols, keypoints, num_cols);
  database_.AddKeypoints(8, {});
  const DatabaseReader reader(Path());
  for (const int num_cols : {2, 4, 6}) EXPECT_EQ(reader.ReadKeypoints(num_cols), keypoints);
  EXPECT_THAT(reader.ReadKeypoints(8), IsEmpty());
}

TEST_P(DatabaseReaderTest, MatchesAreOrientedAndSorted) {
  database_.AddMatches(1, 2, {{9, 0}, {1, 2}, {1, 1}});
  database_.AddMatches(4, 3, {{9, 0}, {1, 2}, {1, 1}});
  const DatabaseReader reader(Path());
  const Matches expected = {{1, 1}, {1, 2}, {9, 0}}, exchanged = {{0, 9}, {1, 1}, {2, 1}};
  EXPECT_EQ(reader.ReadMatches(1, 2), expected);
  EXPECT_EQ(reader.ReadMatches(2, 1), exchanged);
  EXPECT_EQ(reader.ReadMatches(4, 3), expected);
  EXPECT_EQ(reader.ReadMatches(3, 4), exchanged);
}

TEST_P(DatabaseReaderTest, TwoViewGeometryRoundTripInBothOrientations) {
  const TwoViewGeometry geometry = TestGeometry();
  database_.AddTwoViewGeometry(/*query_id=*/5, /*database_id=*/3, geometry);
  database_.AddTwoViewGeometry(/*query_id=*/3, /*database_id=*/2000000000, geometry);
  const DatabaseReader reader(Path());
  for (const auto& [query_id, database_id] : {std::pair(5u, 3u), std::pair(3u, 2000000000u)}) {
    const TwoViewGeometry read = reader.ReadTwoViewGeometry(query_id, database_id).value();
    EXPECT_EQ(read.config, TwoViewConfig::PLANAR);
    EXPECT_EQ(read.inlier_matches, geometry.inlier_matches);
    EXPECT_EQ(read.E, geometry.E);
    EXPECT_EQ(read.F, geometry.F);
    EXPECT_LE((*read.H - *geometry.H).norm(), 1e-12 * geometry.H->norm());
    ASSERT_EQ(read.query_from_other.has_value(), HasPoses());
    if (!HasPoses()) continue;
    EXPECT_LE(read.query_from_other->rotation.angularDistance(geometry.query_from_other->rotation), 3e-10);
    EXPECT_LE((read.query_from_other->translation - geometry.query_from_other->translation).norm(), 3e-10);
  }
}

// Checks without a round trip that the geometry maps a point of the database image to the query.
TEST_P(DatabaseReaderTest, OtherOrientationIsTheInverse) {
  const TwoViewGeometry geometry = TestGeometry();
  database_.AddTwoViewGeometry(/*query_id=*/5, /*database_id=*/3, geometry);
  const TwoViewGeometry read = DatabaseReader(Path()).ReadTwoViewGeometry(/*query_id=*/3, /*database_id=*/5).value();
  const Eigen::Vector3d x_in_3(0.2, -0.1, 1), x_in_5 = *geometry.query_from_other * (4 * x_in_3);
  EXPECT_NEAR(x_in_3.dot(*read.E * x_in_5), 0, 1e-14);
  EXPECT_EQ(*read.F, geometry.F->transpose());
  EXPECT_TRUE((*read.H * *geometry.H).isIdentity(1e-9));
  EXPECT_EQ(read.inlier_matches, (Matches{{0, 7}, {4, 1}, {4, 2}, {9, 0}}));
  if (HasPoses()) {
    EXPECT_LE((*read.query_from_other * x_in_5 - 4 * x_in_3).norm(), 2e-9);
  }
}

TEST_P(DatabaseReaderTest, StorageOrderDoesNotMatter) {
  TwoViewGeometry geometry = TestGeometry();
  geometry.query_from_other->translation *= 17;
  geometry.query_from_other->rotation.coeffs() *= -1;
  database_.AddTwoViewGeometry(/*query_id=*/1, /*database_id=*/2, geometry);
  database_.AddTwoViewGeometry(/*query_id=*/4, /*database_id=*/3, geometry);
  const DatabaseReader reader(Path());
  for (const bool is_exchanged : {false, true}) {
    const auto a = is_exchanged ? reader.ReadTwoViewGeometry(2, 1) : reader.ReadTwoViewGeometry(1, 2);
    const auto b = is_exchanged ? reader.ReadTwoViewGeometry(3, 4) : reader.ReadTwoViewGeometry(4, 3);
    EXPECT_EQ(a->inlier_matches, b->inlier_matches);
    EXPECT_EQ(a->E, b->E);
    EXPECT_EQ(a->F, b->F);
    EXPECT_LE((*a->H - *b->H).norm(), 1e-12 * a->H->norm());
    if (!HasPoses()) continue;
    EXPECT_EQ(a->query_from_other->rotation.coeffs(), b->query_from_other->rotation.coeffs());
    EXPECT_EQ(a->query_from_other->translation, b->query_from_other->translation);
  }
}

TEST_P(DatabaseReaderTest, UnsetGeometryIsNone) {
  TwoViewGeometry geometry;
  geometry.config = TwoViewConfig::CALIBRATED;
  geometry.inlier_matches = {{1, 2}};
  database_.AddTwoViewGeometry(2, 1, geometry);
  database_.AddTwoViewGeometry(3, 4, geometry);  // stored exchanged
  const DatabaseReader reader(Path());
  for (const auto& [query_id, database_id] : {std::pair(2, 1), std::pair(1, 2), std::pair(3, 4), std::pair(4, 3)}) {
    const TwoViewGeometry read = reader.ReadTwoViewGeometry(query_id, database_id).value();
    EXPECT_EQ(read.inlier_matches.size(), 1u);
    EXPECT_FALSE(read.E || read.F || read.H || read.query_from_other || read.query_camera || read.other_camera);
  }
}

// Both COLMAP's database.py and hloc fill in identities.
TEST_P(DatabaseReaderTest, IdentitiesAreNone) {
  TwoViewGeometry geometry;
  geometry.E = geometry.F = geometry.H = Eigen::Matrix3d::Identity();
  geometry.query_from_other = Rigid3d();
  database_.AddTwoViewGeometry(2, 1, geometry);
  const TwoViewGeometry read = DatabaseReader(Path()).ReadTwoViewGeometry(2, 1).value();
  EXPECT_FALSE(read.E || read.F || read.H || read.query_from_other);
}

TEST_P(DatabaseReaderTest, PanoramicPairKeepsItsRotation) {
  TwoViewGeometry geometry;
  geometry.config = TwoViewConfig::PANORAMIC;
  geometry.query_from_other = Rigid3d{Eigen::Quaterniond(0.8, 0, -0.6, 0), Eigen::Vector3d::Zero()};
  database_.AddTwoViewGeometry(2, 1, geometry);
  const TwoViewGeometry read = DatabaseReader(Path()).ReadTwoViewGeometry(1, 2).value();
  ASSERT_EQ(read.query_from_other.has_value(), HasPoses());
  if (!HasPoses()) return;
  EXPECT_NEAR(read.query_from_other->rotation.y(), 0.6, 2e-10);
  EXPECT_EQ(read.query_from_other->translation, Eigen::Vector3d::Zero());
}

TEST_P(DatabaseReaderTest, PairWithoutMatchesIsReadButNotCounted) {
  TwoViewGeometry geometry;
  geometry.config = TwoViewConfig::DEGENERATE;
  for (const uint32_t id : {1, 2}) database_.AddImage(id, 1, std::to_string(id));
  database_.AddTwoViewGeometry(2, 1, geometry);
  database_.AddMatches(2, 1, {});
  database_.Execute("UPDATE matches SET cols = 0");
  const DatabaseReader reader(Path());
  EXPECT_EQ(reader.ReadTwoViewGeometry(2, 1)->config, TwoViewConfig::DEGENERATE);
  EXPECT_THAT(reader.ReadMatches(2, 1), IsEmpty());
  EXPECT_THAT(reader.ReadInlierCounts(1, {2}), IsEmpty());
  EXPECT_THAT(reader.ReadMatchCounts(2, {1}), IsEmpty());
}

TEST_P(DatabaseReaderTest, CountsOfPairsOnBothSides) {
  TwoViewGeometry geometry = TestGeometry();
  for (const uint32_t id : {1, 3, 5, 2147483646}) database_.AddImage(id, 1, std::to_string(id));
  database_.AddTwoViewGeometry(3, 1, geometry);
  database_.AddTwoViewGeometry(2147483646, 3, geometry);
  database_.AddTwoViewGeometry(1, 5, geometry);
  database_.AddTwoViewGeometry(3, 4, geometry);  // of a pair that is not read
  database_.AddTwoViewGeometry(2, 3, geometry);
  database_.AddMatches(5, 3, {{1, 1}, {2, 2}});
  const DatabaseReader reader(Path());
  const std::vector<uint32_t> ids = {1, 3, 5, 2147483646};
  EXPECT_EQ(AsCounts(reader.ReadInlierCounts(3, ids)), (Counts{{1, 4}, {2147483646, 4}}));
  EXPECT_EQ(AsCounts(reader.ReadInlierCounts(2147483646, ids)), (Counts{{3, 4}}));
  EXPECT_EQ(AsCounts(reader.ReadInlierCounts(1, ids)), (Counts{{3, 4}, {5, 4}}));
  EXPECT_EQ(AsCounts(reader.ReadInlierCounts(1, {5})), (Counts{{5, 4}}));
  EXPECT_EQ(AsCounts(reader.ReadMatchCounts(3, ids)), (Counts{{5, 2}}));
  EXPECT_THAT(reader.ReadInlierCounts(3, {}), IsEmpty());
}

TEST(DatabaseReader, ZeroQuaternionIsNoPose) {
  const TestFolder folder;
  TestDatabase database(folder / "a.db", Schema::V3_8);
  database.AddTwoViewGeometry(2, 1, TestGeometry());
  database.Execute("UPDATE two_view_geometries SET qvec = zeroblob(32)");
  EXPECT_FALSE(DatabaseReader(folder / "a.db").ReadTwoViewGeometry(2, 1)->query_from_other);
}

TEST(DatabaseReader, OwnCamerasOfAPairFollowItsOrientation) {
  const TestFolder folder;
  TestDatabase database(folder / "a.db", Schema::V4_2);
  TwoViewGeometry geometry = TestGeometry();
  geometry.query_camera = TestCamera(7);
  database.AddTwoViewGeometry(2, 1, geometry);
  database.AddTwoViewGeometry(3, 4, geometry);
  const DatabaseReader reader(folder / "a.db");
  for (const auto& [query_id, database_id] : {std::pair(2, 1), std::pair(3, 4)}) {
    const TwoViewGeometry read = reader.ReadTwoViewGeometry(query_id, database_id).value();
    EXPECT_FALSE(read.other_camera);
    ASSERT_TRUE(read.query_camera);
    EXPECT_EQ(read.query_camera->camera_id, 7u);
    EXPECT_TRUE(read.query_camera->has_prior_focal_length);
    EXPECT_TRUE(SameIntrinsics(*read.query_camera, TestCamera(7)));
    EXPECT_EQ(reader.ReadTwoViewGeometry(database_id, query_id)->other_camera->camera_id, 7u);
  }
}

TEST(DatabaseReader, CountsAreRightAmong20000Images) {
  const TestFolder folder;
  TestDatabase database(folder / "a.db", Schema::V3_10);
  database.Execute(
      "BEGIN;"
      "WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n WHERE id < 20000)"
      "  INSERT INTO images(image_id, name, camera_id) SELECT id, id || '.jpg', 1 FROM n;"
      // Pairs every image with its five successors and with image 10000.
      "INSERT INTO two_view_geometries(pair_id, rows, cols, data, config)"
      "  SELECT image_id * 2147483647 + image_id + k.column1, image_id % 3, 2, zeroblob(8 * (image_id % 3)), 2"
      "  FROM images, (VALUES (1), (2), (3), (4), (5)) k;"
      "INSERT OR IGNORE INTO two_view_geometries(pair_id, rows, cols, data, config)"
      "  SELECT min(image_id, 10000) * 2147483647 + max(image_id, 10000), 1, 2, zeroblob(8), 2"
      "  FROM images WHERE image_id != 10000;"
      "COMMIT");
  database.Close();
  const DatabaseReader reader(folder / "a.db");
  std::vector<uint32_t> ids;
  for (const DatabaseImage& image : reader.ReadImages()) ids.push_back(image.image_id);
  std::sort(ids.begin(), ids.end());
  EXPECT_EQ(ids.size(), 20000u);
  EXPECT_EQ(AsCounts(reader.ReadInlierCounts(100, ids)),
            (Counts{{95, 2}, {97, 1}, {98, 2}, {101, 1}, {102, 1}, {103, 1}, {104, 1}, {105, 1}, {10000, 1}}));
  Counts of_hub;
  for (uint32_t id = 1; id <= 20000; ++id) {
    const bool is_predecessor = id >= 9995 && id < 10000;
    if (id != 10000 && id != 9996 && id != 9999) of_hub.emplace_back(id, is_predecessor ? id % 3 : 1);
  }
  EXPECT_EQ(AsCounts(reader.ReadInlierCounts(10000, ids)), of_hub);
}

// A damaged row, a function that reads it, and the message: one line with file, table and row.
struct BadRow {
  std::string sql;
  std::function<void(const DatabaseReader&)> read;
  std::string message;
};

std::vector<BadRow> BadRows() {
  const auto read_camera = [](const DatabaseReader& reader) { reader.ReadCamera(1); };
  const auto read_keypoints = [](const DatabaseReader& reader) { reader.ReadKeypoints(1); };
  const auto read_matches = [](const DatabaseReader& reader) { reader.ReadMatches(2, 1); };
  const auto read_geometry = [](const DatabaseReader& reader) { reader.ReadTwoViewGeometry(1, 2); };
  const std::string keypoints = "table keypoints, image 1 (a.jpg): ";
  const std::string matches = "table matches, pair of image 2 (b.jpg) and image 1 (a.jpg): ";
  const std::string geometry = "table two_view_geometries, pair of image 1 (a.jpg) and image 2 (b.jpg): ";
  return {
      {"DELETE FROM cameras", read_camera, "table cameras, camera 1: does not exist"},
      {"UPDATE cameras SET width = 'x'", read_camera, "table cameras, camera 1: width is not an integer"},
      {"UPDATE cameras SET height = -2", read_camera, "table cameras, camera 1: height is out of range: -2"},
      {"UPDATE cameras SET params = x'01'", read_camera, "table cameras, camera 1: camera parameters of 1 bytes"},
      {"UPDATE keypoints SET cols = 3", read_keypoints, keypoints + "has 3 columns"},
      {"UPDATE keypoints SET rows = 3", read_keypoints, keypoints + "data has 48 bytes for 3 x 6 numbers"},
      {"UPDATE keypoints SET rows = 2147483647", read_keypoints,
       keypoints + "data has 48 bytes for 2147483647 x 6 numbers"},
      {"UPDATE keypoints SET rows = -1", read_keypoints, keypoints + "rows is out of range: -1"},
      {"UPDATE keypoints SET rows = 0", read_keypoints, keypoints + "data has 48 bytes for 0 x 6 numbers"},
      {"UPDATE keypoints SET data = NULL", read_keypoints, keypoints + "data has 0 bytes for 2 x 6 numbers"},
      {"UPDATE keypoints SET data = 'text'", read_keypoints, keypoints + "data is not a blob"},
      {"UPDATE keypoints SET rows = 1, cols = 2, data = x'000000000000c07f'", read_keypoints,
       keypoints + "keypoint 0 is not finite"},
      {"UPDATE keypoints SET rows = 1, cols = 2, data = x'0000807f00000000'", read_keypoints,
       keypoints + "keypoint 0 is not finite"},
      {"UPDATE matches SET cols = 4", read_matches, matches + "has 4 columns"},
      {"UPDATE matches SET data = x'00'", read_matches, matches + "data has 1 bytes for 1 x 2 numbers"},
      {"UPDATE matches SET rows = 3000000000", read_matches, matches + "rows is out of range: 3000000000"},
      {"UPDATE cameras SET params = x'000000000000f87f'", read_camera,
       "table cameras, camera 1: a camera parameter is not a finite number"},
      {"UPDATE two_view_geometries SET data = NULL", read_geometry, geometry + "data has 0 bytes for 4 x 2 numbers"},
      {"UPDATE two_view_geometries SET config = 10", read_geometry, geometry + "config is out of range: 10"},
      {"UPDATE two_view_geometries SET E = x'00'", read_geometry, geometry + "E has 1 bytes instead of 72"},
      {"UPDATE two_view_geometries SET qvec = tvec", read_geometry, geometry + "qvec has 24 bytes instead of 32"},
      {"UPDATE two_view_geometries SET camera1 = x'00'", read_geometry, geometry + "camera1 is damaged"},
      {"UPDATE two_view_geometries SET camera2 = substr(camera2, 1, 60)", read_geometry,
       geometry + "camera2 is damaged"},
  };
}

TEST(DatabaseReader, BadRowsAreNamed) {
  for (const BadRow& bad_row : BadRows()) {
    const TestFolder folder;
    TestDatabase database(folder / "a.db", Schema::V4_2);
    database.AddCamera(TestCamera(1));
    database.AddImage(1, 1, "a.jpg");
    database.AddImage(2, 1, "b.jpg");
    database.AddKeypoints(1, {{1, 2}, {3, 4}});
    database.AddMatches(1, 2, {{0, 1}});
    TwoViewGeometry two_view = TestGeometry();
    two_view.query_camera = two_view.other_camera = TestCamera(1);
    database.AddTwoViewGeometry(2, 1, two_view);
    database.Execute(bad_row.sql);
    const DatabaseReader reader(folder / "a.db");
    EXPECT_THAT([&] { bad_row.read(reader); },
                ThrowsMessage<DamagedRecordError>((folder / "a.db").string() + ": " + bad_row.message))
        << bad_row.sql;
  }
}

TEST(DatabaseReader, DamagedImagesAreLeftOut) {
  const TestFolder folder;
  TestDatabase database(folder / "a.db", Schema::V3_10);
  database.Execute(
      "DROP INDEX index_name; DROP TABLE images; CREATE TABLE images(image_id INTEGER PRIMARY KEY, name, camera_id);"
      "INSERT INTO images VALUES (1, 'twin\x1B', 1), (2, 'good', 1), (3, 'twin\x1B', 1), (4, x'0102', 1), (5, 'b', -1),"
      "(-6, 'c', 1), (7, 'two\nlines', 1), (8, '', 1)");
  std::vector<DamagedImage> damaged;
  const std::vector<DatabaseImage> images = DatabaseReader(folder / "a.db").ReadImages(&damaged);
  ASSERT_EQ(images.size(), 1u);
  EXPECT_EQ(images[0].name, "good");
  std::vector<std::string> found;
  for (const DamagedImage& image : damaged) found.push_back("[" + image.name + "] " + image.damage);
  EXPECT_THAT(found, UnorderedElementsAre("[] table images, image 4: name is not text",
                                          "[] table images, image 7: 'two\\nlines' is not the name of a file",
                                          "[] table images, image 8: '' is not the name of a file",
                                          "[b] table images, image 5: camera_id is out of range: -1",
                                          "[c] table images, image -6: image_id is out of range: -6",
                                          "[twin\x1B] table images: several images have the name twin\\x1b",
                                          "[twin\x1B] table images: several images have the name twin\\x1b"));
}

TEST(DatabaseReader, PairsWithADamagedNumberOfMatchesAreCounted) {
  const TestFolder folder;
  TestDatabase database(folder / "a.db", Schema::V3_10);
  for (const int image_id : {1, 2, 3, 4}) database.AddImage(image_id, 1, std::to_string(image_id) + ".jpg");
  for (const int image_id : {1, 3, 4}) database.AddMatches(2, image_id, {{0, 1}, {1, 0}});
  database.Execute("UPDATE matches SET rows = -7 WHERE pair_id = 2147483647 + 2");
  database.Execute("UPDATE matches SET rows = 'many' WHERE pair_id = 2 * 2147483647 + 3");
  EXPECT_EQ(AsCounts(DatabaseReader(folder / "a.db").ReadMatchCounts(2, {1, 3, 4})), (Counts{{1, 1}, {3, 1}, {4, 2}}));
}

// Damages the page of one image's keypoints, as a disk may.
TEST(DatabaseReader, DamagedPageIsTheDamageOfItsRecords) {
  const TestFolder folder;
  const std::filesystem::path path = folder / "a.db";
  {
    TestDatabase database(path, Schema::V3_8);
    for (const int image_id : {1, 2}) {
      database.AddImage(image_id, 1, std::to_string(image_id) + ".jpg");
      database.AddKeypoints(image_id, std::vector<Eigen::Vector2d>(3000, {image_id, image_id}), /*num_cols=*/2);
    }
  }
  std::string bytes = ReadBytes(path);
  // Finds the first page that holds nothing but keypoints of image 1 and, in its first four bytes, the next page.
  std::string ones;
  while (ones.size() < 4092) ones += std::string("\0\0\x80\x3f", 4);
  const size_t page = bytes.find(ones) - 4;
  ASSERT_EQ(page % 4096, 0u);
  bytes.replace(page, 4, "\x7f\xff\xff\xff");
  WriteBytes(path, bytes);
  const DatabaseReader reader(path);
  EXPECT_THAT(
      [&] { reader.ReadKeypoints(1); },
      ThrowsMessage<DamagedRecordError>(
          path.string() + ": table keypoints, image 1 (1.jpg): cannot be read: database disk image is malformed"));
  EXPECT_EQ(reader.ReadKeypoints(2).size(), 3000u);
}

TEST(DatabaseReader, ReadsOnAfterABadRow) {
  const TestFolder folder;
  TestDatabase database(folder / "a.db", Schema::V3_10);
  database.AddKeypoints(1, {{std::numeric_limits<double>::quiet_NaN(), 1}});
  database.AddKeypoints(2, {{1, 2}});
  const DatabaseReader reader(folder / "a.db");
  EXPECT_THROW(reader.ReadKeypoints(1), InputError);
  EXPECT_EQ(reader.ReadKeypoints(2).size(), 1u);
}

// Makes a database of COLMAP 4.2 with 11 images.
TEST(DatabaseReader, RealDatabase) {
  const char* data = std::getenv("LAZYLOC_SHARED_DATA");
  const std::filesystem::path folder = data == nullptr ? "" : std::filesystem::path(data) / "fountain";
  if (!std::filesystem::exists(folder / "database.db")) GTEST_SKIP() << "LAZYLOC_SHARED_DATA has no fountain";
  const FolderState before = ReadFolderState(folder);
  const DatabaseReader reader(folder / "database.db");
  const std::vector<DatabaseImage> images = reader.ReadImages();
  ASSERT_EQ(images.size(), 11u);
  std::vector<uint32_t> ids;
  for (const DatabaseImage& image : images) ids.push_back(image.image_id);
  std::sort(ids.begin(), ids.end());
  int num_poses = 0;
  for (const DatabaseImage& query : images) {
    EXPECT_FALSE(reader.ReadCamera(query.camera_id).params.empty());
    const size_t num_query_keypoints = reader.ReadKeypoints(query.image_id).size();
    EXPECT_GT(num_query_keypoints, 1000u);
    const std::vector<PairSize> sizes = reader.ReadInlierCounts(query.image_id, ids);
    EXPECT_GE(sizes.size(), 5u);
    EXPECT_GE(reader.ReadMatchCounts(query.image_id, ids).size(), sizes.size());
    for (const PairSize& size : sizes) {
      const auto geometry = reader.ReadTwoViewGeometry(query.image_id, size.image_id);
      ASSERT_TRUE(geometry);
      EXPECT_EQ(geometry->inlier_matches.size(), static_cast<size_t>(size.num_matches));
      EXPECT_LT(geometry->inlier_matches.back().query_point, num_query_keypoints);
      if (!geometry->query_from_other) continue;
      ++num_poses;
      EXPECT_NEAR(geometry->query_from_other->translation.norm(), 1, 3e-10);
    }
  }
  EXPECT_GT(num_poses, 50);
  EXPECT_EQ(ReadFolderState(folder), before);
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/results/model_merger.h"

#include <limits>

#include <gmock/gmock.h>

#include "colmap_lazyloc/files/binary_file.h"
#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/results/model_writer.h"
#include "colmap_lazyloc/runs/records_test_fixture.h"
#include "colmap_lazyloc/testing/test_database.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Pair;
using ::testing::SizeIs;

Camera MakeCamera(uint32_t camera_id, double focal_length) {
  return {camera_id, /*model_id=*/0, 640, 480, {focal_length, 320, 240}, false};
}

ModelImage MakeImage(uint32_t image_id, uint32_t camera_id, const std::string& name) {
  return {image_id, camera_id, name, {Eigen::Quaterniond(2, 0.1 * image_id, 0, 0), {1.0 * image_id, 0.1, 0}}};
}

LocalizationResult MakeQuery(const std::string& name, const Camera& camera) {
  LocalizationResult query;
  query.query_name = name;
  query.status = QueryStatus::LOCALIZED;
  query.query_camera = camera;
  query.cam_from_world.translation = Eigen::Vector3d(7, 8, 9);
  query.pairs = {{"a", 10, 0, 0}, {"b", 10, 0, 0}};
  return query;
}

PointResult MakePoint(int query_point, const std::vector<std::pair<int, int>>& observations) {
  return {Eigen::Vector3d(query_point, 0, 1), query_point, observations, 0.5};
}

struct WrittenImage {
  ModelImage image;
  std::vector<Eigen::Vector2d> keypoints;
  std::map<uint32_t, uint64_t> point_of_keypoint;
};

struct WrittenPoint {
  Eigen::Vector3d point_in_world;
  double mean_reprojection_error_px = 0;
  std::vector<std::pair<uint32_t, uint32_t>> track;  // image id, keypoint
};

struct WrittenModel {
  std::map<uint32_t, Camera> cameras;
  std::map<uint32_t, WrittenImage> images;
  std::vector<WrittenPoint> points;  // the point with id i is points[i - 1]
};

void ReadKeypoints(BinaryFile* file, WrittenImage* image) {
  const uint64_t num_keypoints = file->ReadCount();
  for (uint32_t i = 0; i < num_keypoints; ++i) {
    const double x = file->Read<double>(), y = file->Read<double>();
    image->keypoints.emplace_back(x, y);
    const auto point_id = file->Read<uint64_t>();
    if (point_id != std::numeric_limits<uint64_t>::max()) image->point_of_keypoint[i] = point_id;
  }
}

// Reads a model with its image points and points, which ReadModel leaves out.
WrittenModel ReadWritten(const std::filesystem::path& folder) {
  WrittenModel model;
  const Model posed = ReadModel(folder);
  model.cameras = posed.cameras;
  BinaryFile images(folder / "images.bin");
  for (uint64_t i = images.ReadCount(); i > 0; --i) {
    const auto image_id = images.Read<uint32_t>();
    images.Skip(7 * 8 + 4);
    const ModelImage* image = FindByName(posed.images, images.ReadName());
    EXPECT_EQ(image->image_id, image_id);
    model.images[image_id].image = *image;
    ReadKeypoints(&images, &model.images[image_id]);
  }
  images.CheckEnd();
  BinaryFile points(folder / "points3D.bin");
  for (uint64_t i = points.ReadCount(); i > 0; --i) {
    WrittenPoint point;
    EXPECT_EQ(points.Read<uint64_t>(), model.points.size() + 1);
    for (double& coordinate : point.point_in_world) coordinate = points.Read<double>();
    points.Skip(3);
    point.mean_reprojection_error_px = points.Read<double>();
    for (uint64_t k = points.ReadCount(); k > 0; --k) {
      const auto image_id = points.Read<uint32_t>();
      point.track.emplace_back(image_id, points.Read<uint32_t>());
    }
    model.points.push_back(point);
  }
  points.CheckEnd();
  return model;
}

// Images a (id 1 here, 11 in the database) and b (2, 12); queries q (database id 20) and r (21). The x of the keypoints
// of an image is its id in the database.
class MergeModelTest : public RecordsTest {
 protected:
  WrittenModel Merge() const {
    std::vector<QueryRecord> records;
    for (const LocalizationResult& query : queries_) records.push_back({query, {}, {}, 0});
    const std::filesystem::path database_path = folder_ / "database.db", model_path = folder_ / "written";
    std::filesystem::remove(database_path);
    std::filesystem::create_directory(model_path);
    TestDatabase database(database_path, TestDatabase::Schema::V3_10);
    for (const DatabaseImage& image : database_images_) {
      database.AddImage(static_cast<int>(image.image_id), static_cast<int>(image.camera_id), image.name);
      database.AddKeypoints(static_cast<int>(image.image_id),
                            std::vector<Eigen::Vector2d>(10, Eigen::Vector2d(image.image_id, 0)));
    }
    database.Close();
    const DatabaseReader reader(database_path);
    WriteModel(model_path, folder_ / "scratch", model_, Stored(records), {reader, reader.ReadImages()});
    return ReadWritten(model_path);
  }

  Model model_{
      {{1, MakeCamera(1, 500)}, {2, MakeCamera(2, 600)}}, {MakeImage(1, 1, "a"), MakeImage(2, 2, "b")}, {}, {}, {}};
  std::vector<DatabaseImage> database_images_ = {{11, 1, "a"}, {12, 1, "b"}, {20, 1, "q"}, {21, 1, "r"}};
  std::vector<LocalizationResult> queries_ = {MakeQuery("q", MakeCamera(1, 500)), MakeQuery("r", MakeCamera(1, 500))};
};

// Every image point names a point whose track names it back, and the reverse.
void ExpectConsistent(const WrittenModel& merged) {
  size_t num_elements = 0, num_image_points = 0;
  for (size_t i = 0; i < merged.points.size(); ++i) {
    EXPECT_GE(merged.points[i].track.size(), 2);
    num_elements += merged.points[i].track.size();
    for (const auto& [image_id, keypoint] : merged.points[i].track) {
      EXPECT_EQ(merged.images.at(image_id).point_of_keypoint.at(keypoint), i + 1);
    }
  }
  for (const auto& [image_id, image] : merged.images) num_image_points += image.point_of_keypoint.size();
  EXPECT_EQ(num_elements, num_image_points);
}

TEST_F(MergeModelTest, ModelKeepsIdsAndPoseBits) {
  const WrittenModel merged = Merge();
  EXPECT_THAT(merged.images, ElementsAre(Pair(1, ::testing::_), Pair(2, ::testing::_), Pair(20, ::testing::_),
                                         Pair(21, ::testing::_)));
  for (const ModelImage& image : model_.images) {
    const ModelImage& kept = merged.images.at(image.image_id).image;
    EXPECT_EQ(kept.name, image.name);
    EXPECT_EQ(kept.camera_id, image.camera_id);
    EXPECT_EQ(kept.cam_from_world.rotation.coeffs(), image.cam_from_world.rotation.coeffs());
    EXPECT_EQ(kept.cam_from_world.translation, image.cam_from_world.translation);
    EXPECT_THAT(merged.images.at(image.image_id).keypoints, IsEmpty()) << "not observed";
  }
  EXPECT_EQ(merged.images.at(20).image.name, "q");
  EXPECT_EQ(merged.images.at(20).keypoints.at(0).x(), 20);
  EXPECT_EQ(merged.images.at(20).image.cam_from_world.translation, Eigen::Vector3d(7, 8, 9));
}

TEST_F(MergeModelTest, QueryWhoseIdIsTakenGetsOneAboveAll) {
  model_.images[1].image_id = 20;
  model_.images.push_back(MakeImage(30, 1, "c"));
  const WrittenModel merged = Merge();
  EXPECT_EQ(merged.images.at(20).image.name, "b");
  EXPECT_EQ(merged.images.at(21).image.name, "r");
  EXPECT_EQ(merged.images.at(31).image.name, "q");
  EXPECT_EQ(merged.images.at(31).image.image_id, 31);
  EXPECT_EQ(merged.images.at(31).keypoints.at(0).x(), 20);
}

TEST_F(MergeModelTest, RefinedCameraKeepsItsIdUnlessOthersShareIt) {
  database_images_ = {{11, 1, "a"}, {12, 1, "b"}, {20, 7, "q"}, {21, 8, "r"}, {22, 8, "s"}};
  queries_ = {MakeQuery("q", MakeCamera(7, 505)), MakeQuery("r", MakeCamera(8, 510))};
  for (LocalizationResult& query : queries_) query.is_camera_refined = true;
  const WrittenModel merged = Merge();
  EXPECT_EQ(merged.images.at(20).image.camera_id, 7);
  EXPECT_EQ(merged.images.at(21).image.camera_id, 9);
  EXPECT_EQ(merged.cameras.at(7).params[0], 505);
  EXPECT_EQ(merged.cameras.at(9).params[0], 510);
  EXPECT_EQ(merged.cameras.count(8), 0);
}

TEST_F(MergeModelTest, NoIdLeftIsAnError) {
  model_.images[0].image_id = std::numeric_limits<uint32_t>::max() - 1;
  model_.images[1].image_id = 20;
  EXPECT_THROW(Merge(), InputError);
}

TEST_F(MergeModelTest, QueryCameraIsReusedWhereIntrinsicsAgree) {
  model_.cameras[5] = MakeCamera(5, 500);
  queries_ = {MakeQuery("q", MakeCamera(5, 500)), MakeQuery("r", MakeCamera(2, 500))};
  const WrittenModel merged = Merge();
  EXPECT_EQ(merged.images.at(20).image.camera_id, 5) << "its own id is preferred";
  EXPECT_EQ(merged.images.at(21).image.camera_id, 1) << "the first with these intrinsics";
  EXPECT_THAT(merged.cameras, SizeIs(3));
}

TEST_F(MergeModelTest, NewQueryCameraKeepsItsIdWhereFree) {
  queries_ = {MakeQuery("q", MakeCamera(2, 700)), MakeQuery("r", MakeCamera(9, 800)),
              MakeQuery("s", MakeCamera(0, 700)), MakeQuery("t", MakeCamera(0, 900))};
  database_images_.push_back({22, 1, "s"});
  database_images_.push_back({23, 1, "t"});
  const WrittenModel merged = Merge();
  EXPECT_EQ(merged.images.at(20).image.camera_id, 10) << "2 is another camera's; 9 is another query's";
  EXPECT_EQ(merged.images.at(21).image.camera_id, 9);
  EXPECT_EQ(merged.images.at(22).image.camera_id, 10) << "queries share cameras too";
  EXPECT_EQ(merged.images.at(23).image.camera_id, 11) << "0 is no id";
  EXPECT_EQ(merged.cameras.at(10).camera_id, 10);
  EXPECT_EQ(merged.cameras.at(10).params[0], 700);
  EXPECT_EQ(merged.cameras.at(2).params[0], 600);
}

TEST_F(MergeModelTest, TracksJoinQueryAndDatabaseKeypoints) {
  queries_[0].points = {MakePoint(3, {{0, 5}, {1, 6}}), MakePoint(4, {{1, 7}})};
  const WrittenModel merged = Merge();
  ASSERT_THAT(merged.points, SizeIs(2));
  EXPECT_THAT(merged.points[0].track, ElementsAre(Pair(20, 3), Pair(1, 5), Pair(2, 6)));
  EXPECT_THAT(merged.points[1].track, ElementsAre(Pair(20, 4), Pair(2, 7)));
  EXPECT_EQ(merged.points[0].point_in_world, Eigen::Vector3d(3, 0, 1));
  EXPECT_EQ(merged.points[0].mean_reprojection_error_px, 0.5);
  EXPECT_EQ(merged.images.at(1).keypoints.at(0).x(), 11);
  EXPECT_EQ(merged.images.at(2).keypoints.at(0).x(), 12);
  ExpectConsistent(merged);
}

TEST_F(MergeModelTest, SharedKeypointStaysWithTheFirstQuery) {
  queries_[0].points = {MakePoint(0, {{0, 5}, {1, 6}})};
  queries_[1].points = {MakePoint(0, {{0, 5}}), MakePoint(1, {{0, 5}, {1, 8}}), MakePoint(2, {{0, 9}})};
  const WrittenModel merged = Merge();
  ASSERT_THAT(merged.points, SizeIs(3));
  EXPECT_THAT(merged.points[0].track, ElementsAre(Pair(20, 0), Pair(1, 5), Pair(2, 6)));
  EXPECT_THAT(merged.points[1].track, ElementsAre(Pair(21, 1), Pair(2, 8)));
  EXPECT_THAT(merged.points[2].track, ElementsAre(Pair(21, 2), Pair(1, 9)));
  EXPECT_EQ(merged.images.at(21).point_of_keypoint.count(0), 0) << "the dropped point leaves no trace";
  ExpectConsistent(merged);
}

TEST_F(MergeModelTest, ObservationsByImagesOutsideTheModelAreLeftOut) {
  queries_[0].pairs.push_back({"gone", 10, 0, 0});
  queries_[0].points = {MakePoint(0, {{2, 1}}), MakePoint(1, {{2, 1}, {0, 2}})};
  const WrittenModel merged = Merge();
  ASSERT_THAT(merged.points, SizeIs(1));
  EXPECT_THAT(merged.points[0].track, ElementsAre(Pair(20, 1), Pair(1, 2)));
}

TEST_F(MergeModelTest, QueriesThatAreNotLocalizedAreLeftOut) {
  queries_[0].status = QueryStatus::TOO_FEW_TRACKS;
  queries_[0].points = {MakePoint(0, {{0, 5}})};
  const WrittenModel merged = Merge();
  EXPECT_EQ(merged.images.count(20), 0);
  EXPECT_THAT(merged.points, IsEmpty());
}

// Checks leave-one-out, in which model/ must not show the pose of an image that was not localized.
TEST_F(MergeModelTest, ImageThatWasAQueryAppearsAsLocalizedOrNotAtAll) {
  queries_ = {MakeQuery("a", MakeCamera(1, 500)), MakeQuery("b", MakeCamera(2, 600))};
  queries_[0].points = {MakePoint(0, {{1, 6}})};
  WrittenModel merged = Merge();
  EXPECT_THAT(merged.images, SizeIs(2));
  EXPECT_EQ(merged.images.at(1).image.name, "a") << "under its id of the model";
  EXPECT_EQ(merged.images.at(1).keypoints.at(0).x(), 11);
  EXPECT_EQ(merged.images.at(1).image.cam_from_world.translation, Eigen::Vector3d(7, 8, 9));
  EXPECT_THAT(merged.points.at(0).track, ElementsAre(Pair(1, 0), Pair(2, 6)));
  ExpectConsistent(merged);

  queries_[1].status = QueryStatus::DIVERGED;
  merged = Merge();
  EXPECT_THAT(merged.images, ElementsAre(Pair(1, ::testing::_)));
  EXPECT_THAT(merged.points, IsEmpty());
}

}  // namespace
}  // namespace lazyloc

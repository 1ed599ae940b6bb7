#include "colmap_lazyloc/io/model_merger.h"

#include <limits>

#include <gmock/gmock.h>

#include "colmap_lazyloc/scene/errors.h"

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

std::vector<std::pair<uint32_t, uint32_t>> Track(const MergedPoint& point) {
  std::vector<std::pair<uint32_t, uint32_t>> track;
  for (const TrackElement& element : point.track) track.emplace_back(element.image_id, element.keypoint);
  return track;
}

// Images a (id 1 here, 11 in the database) and b (2, 12); queries q (database id 20) and r (21).
class MergeModelTest : public ::testing::Test {
 protected:
  MergedModel Merge() const {
    std::vector<QueryRecord> records;
    for (const LocalizationResult& query : queries_) records.push_back({query, {}, {}, 0});
    std::vector<const QueryRecord*> pointers;
    for (const QueryRecord& record : records) pointers.push_back(&record);
    return MergeModel(model_, pointers, database_images_);
  }

  Model model_{
      {{1, MakeCamera(1, 500)}, {2, MakeCamera(2, 600)}}, {MakeImage(1, 1, "a"), MakeImage(2, 2, "b")}, {}, {}};
  std::vector<DatabaseImage> database_images_ = {{11, 1, "a"}, {12, 1, "b"}, {20, 1, "q"}, {21, 1, "r"}};
  std::vector<LocalizationResult> queries_ = {MakeQuery("q", MakeCamera(1, 500)), MakeQuery("r", MakeCamera(1, 500))};
};

// Every image point names a point whose track names it back, and the reverse.
void ExpectConsistent(const MergedModel& merged) {
  size_t num_elements = 0, num_image_points = 0;
  for (size_t i = 0; i < merged.points.size(); ++i) {
    EXPECT_GE(merged.points[i].track.size(), 2);
    num_elements += merged.points[i].track.size();
    for (const TrackElement& element : merged.points[i].track) {
      EXPECT_EQ(merged.images.at(element.image_id).point_of_keypoint.at(element.keypoint), i + 1);
    }
  }
  for (const auto& [image_id, image] : merged.images) num_image_points += image.point_of_keypoint.size();
  EXPECT_EQ(num_elements, num_image_points);
}

TEST_F(MergeModelTest, ModelKeepsIdsAndPoseBits) {
  const MergedModel merged = Merge();
  EXPECT_THAT(merged.images, ElementsAre(Pair(1, ::testing::_), Pair(2, ::testing::_), Pair(20, ::testing::_),
                                         Pair(21, ::testing::_)));
  for (const ModelImage& image : model_.images) {
    const ModelImage& kept = merged.images.at(image.image_id).image;
    EXPECT_EQ(kept.name, image.name);
    EXPECT_EQ(kept.camera_id, image.camera_id);
    EXPECT_EQ(kept.cam_from_world.rotation.coeffs(), image.cam_from_world.rotation.coeffs());
    EXPECT_EQ(kept.cam_from_world.translation, image.cam_from_world.translation);
    EXPECT_FALSE(merged.images.at(image.image_id).database_id.has_value()) << "not observed: no keypoints";
  }
  EXPECT_EQ(merged.images.at(20).image.name, "q");
  EXPECT_EQ(merged.images.at(20).database_id, 20);
  EXPECT_EQ(merged.images.at(20).image.cam_from_world.translation, Eigen::Vector3d(7, 8, 9));
}

TEST_F(MergeModelTest, QueryWhoseIdIsTakenGetsOneAboveAll) {
  model_.images[1].image_id = 20;
  model_.images.push_back(MakeImage(30, 1, "c"));
  const MergedModel merged = Merge();
  EXPECT_EQ(merged.images.at(20).image.name, "b");
  EXPECT_EQ(merged.images.at(21).image.name, "r");
  EXPECT_EQ(merged.images.at(31).image.name, "q");
  EXPECT_EQ(merged.images.at(31).image.image_id, 31);
  EXPECT_EQ(merged.images.at(31).database_id, 20);
}

TEST_F(MergeModelTest, RefinedCameraKeepsItsIdUnlessOthersShareIt) {
  database_images_ = {{11, 1, "a"}, {12, 1, "b"}, {20, 7, "q"}, {21, 8, "r"}, {22, 8, "s"}};
  queries_ = {MakeQuery("q", MakeCamera(7, 505)), MakeQuery("r", MakeCamera(8, 510))};
  for (LocalizationResult& query : queries_) query.is_camera_refined = true;
  const MergedModel merged = Merge();
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
  const MergedModel merged = Merge();
  EXPECT_EQ(merged.images.at(20).image.camera_id, 5) << "its own id is preferred";
  EXPECT_EQ(merged.images.at(21).image.camera_id, 1) << "the first with these intrinsics";
  EXPECT_THAT(merged.cameras, SizeIs(3));
}

TEST_F(MergeModelTest, NewQueryCameraKeepsItsIdWhereFree) {
  queries_ = {MakeQuery("q", MakeCamera(2, 700)), MakeQuery("r", MakeCamera(9, 800)),
              MakeQuery("s", MakeCamera(0, 700)), MakeQuery("t", MakeCamera(0, 900))};
  database_images_.push_back({22, 1, "s"});
  database_images_.push_back({23, 1, "t"});
  const MergedModel merged = Merge();
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
  const MergedModel merged = Merge();
  ASSERT_THAT(merged.points, SizeIs(2));
  EXPECT_THAT(Track(merged.points[0]), ElementsAre(Pair(20, 3), Pair(1, 5), Pair(2, 6)));
  EXPECT_THAT(Track(merged.points[1]), ElementsAre(Pair(20, 4), Pair(2, 7)));
  EXPECT_EQ(merged.points[0].point_in_world, Eigen::Vector3d(3, 0, 1));
  EXPECT_EQ(merged.points[0].mean_reprojection_error_px, 0.5);
  EXPECT_EQ(merged.images.at(1).database_id, 11);
  EXPECT_EQ(merged.images.at(2).database_id, 12);
  ExpectConsistent(merged);
}

TEST_F(MergeModelTest, SharedKeypointStaysWithTheFirstQuery) {
  queries_[0].points = {MakePoint(0, {{0, 5}, {1, 6}})};
  queries_[1].points = {MakePoint(0, {{0, 5}}), MakePoint(1, {{0, 5}, {1, 8}}), MakePoint(2, {{0, 9}})};
  const MergedModel merged = Merge();
  ASSERT_THAT(merged.points, SizeIs(3));
  EXPECT_THAT(Track(merged.points[0]), ElementsAre(Pair(20, 0), Pair(1, 5), Pair(2, 6)));
  EXPECT_THAT(Track(merged.points[1]), ElementsAre(Pair(21, 1), Pair(2, 8)));
  EXPECT_THAT(Track(merged.points[2]), ElementsAre(Pair(21, 2), Pair(1, 9)));
  EXPECT_EQ(merged.images.at(21).point_of_keypoint.count(0), 0) << "the dropped point leaves no trace";
  ExpectConsistent(merged);
}

TEST_F(MergeModelTest, ObservationsByImagesOutsideTheModelAreLeftOut) {
  queries_[0].pairs.push_back({"gone", 10, 0, 0});
  queries_[0].points = {MakePoint(0, {{2, 1}}), MakePoint(1, {{2, 1}, {0, 2}})};
  const MergedModel merged = Merge();
  ASSERT_THAT(merged.points, SizeIs(1));
  EXPECT_THAT(Track(merged.points[0]), ElementsAre(Pair(20, 1), Pair(1, 2)));
}

TEST_F(MergeModelTest, QueriesThatAreNotLocalizedAreLeftOut) {
  queries_[0].status = QueryStatus::TOO_FEW_TRACKS;
  queries_[0].points = {MakePoint(0, {{0, 5}})};
  const MergedModel merged = Merge();
  EXPECT_EQ(merged.images.count(20), 0);
  EXPECT_THAT(merged.points, IsEmpty());
}

// Checks leave-one-out, in which model/ must not show the pose of an image that was not localized.
TEST_F(MergeModelTest, ImageThatWasAQueryAppearsAsLocalizedOrNotAtAll) {
  queries_ = {MakeQuery("a", MakeCamera(1, 500)), MakeQuery("b", MakeCamera(2, 600))};
  queries_[0].points = {MakePoint(0, {{1, 6}})};
  MergedModel merged = Merge();
  EXPECT_THAT(merged.images, SizeIs(2));
  EXPECT_EQ(merged.images.at(1).image.name, "a") << "under its id of the model";
  EXPECT_EQ(merged.images.at(1).database_id, 11);
  EXPECT_EQ(merged.images.at(1).image.cam_from_world.translation, Eigen::Vector3d(7, 8, 9));
  EXPECT_THAT(Track(merged.points.at(0)), ElementsAre(Pair(1, 0), Pair(2, 6)));
  ExpectConsistent(merged);

  queries_[1].status = QueryStatus::DIVERGED;
  merged = Merge();
  EXPECT_THAT(merged.images, ElementsAre(Pair(1, ::testing::_)));
  EXPECT_THAT(merged.points, IsEmpty());
}

}  // namespace
}  // namespace lazyloc

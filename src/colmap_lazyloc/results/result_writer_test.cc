#include "colmap_lazyloc/results/result_writer.h"

#include <map>
#include <utility>

#include <gmock/gmock.h>

#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/runs/records_test_fixture.h"
#include "colmap_lazyloc/testing/test_database.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

class ResultWriterTest : public RecordsTest {
 protected:
  ResultWriterTest() : database_path_(folder_ / "database.db"), output_(folder_ / "out") {
    model_.cameras[1] = {1, 0, 640, 480, {500, 320, 240}, false};
    model_.images = {{1, 1, "a.jpg", {Eigen::Quaterniond(0.6, 0, 0.8000000001, 0), {1, 2, 3}}},
                     {2, 1, "b.jpg", {Eigen::Quaterniond(1, 0, 0, 0), {0.1, 0.2, 0.3}}}};
    MakeDatabase(database_path_);
    LocalizationResult failed, localized;
    failed.query_name = "r.jpg";
    failed.status = QueryStatus::NO_FEATURES;
    localized.query_name = "q.jpg";
    localized.status = QueryStatus::LOCALIZED;
    localized.query_camera = model_.cameras[1];
    localized.cam_from_world.translation = Eigen::Vector3d(4, 5, 6);
    localized.pairs = {{"a.jpg", 30, 0, 0}};
    localized.points = {{Eigen::Vector3d(7, 8, 9), 1, {{0, 0}}, 0.5}};
    records_ = {{failed, {}, {}, 0}, {localized, {}, {}, 0}};
  }

  void MakeDatabase(const fs::path& path, const std::string& damage = "") const {
    TestDatabase database(path, TestDatabase::Schema::V3_10);
    database.AddCamera(model_.cameras.at(1));
    for (const auto& [image_id, name] : {std::pair{1, "a.jpg"}, {2, "b.jpg"}, {3, "q.jpg"}, {4, "r.jpg"}}) {
      database.AddImage(image_id, 1, name);
    }
    database.AddKeypoints(1, {{10.5, 20.5}, {30.5, 40.5}});
    database.AddKeypoints(2, {{1.5, 2.5}});
    database.AddKeypoints(3, {{100.5, 200.5}, {300.5, 400.5}});
    if (!damage.empty()) database.Execute(damage);
    database.Close();
  }
  void Write(bool is_leave_one_out = false) {
    const LeaveOneOutSummary summary = SummarizeLeaveOneOut(model_, Stored(records_));
    const DatabaseReader database(database_path_);
    ResultWriter(output_).Write(model_, Stored(records_), {database, database.ReadImages()}, "[options]\n",
                                is_leave_one_out ? &summary : nullptr);
  }
  std::string ErrorOfConstruction(const fs::path& path) const {
    return ErrorOf([&] { ResultWriter writer(path); });
  }
  // Returns the relative paths of all files below a folder with their content.
  static std::map<std::string, std::string> Contents(const fs::path& folder) {
    std::map<std::string, std::string> contents;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      contents[entry.path().lexically_relative(folder).string()] = entry.is_directory() ? "" : ReadFile(entry.path());
    }
    return contents;
  }
  static std::vector<std::string> Names(const fs::path& folder) {
    std::vector<std::string> names;
    for (const auto& [name, content] : Contents(folder)) names.push_back(name);
    return names;
  }

  fs::path database_path_, output_;
  Model model_;
  std::vector<QueryRecord> records_;
};

TEST_F(ResultWriterTest, WritesAllFilesAndNothingElse) {
  output_ = folder_ / "new" / "out";
  Write();
  EXPECT_THAT(Names(output_), ElementsAre("model", "model/cameras.bin", "model/images.bin", "model/points3D.bin",
                                          "options.ini", "poses.txt", "positions.csv", "results.jsonl"));
  EXPECT_EQ(ReadFile(output_ / "options.ini"), "[options]\n");
  EXPECT_THAT(ReadFile(output_ / "poses.txt"), HasSubstr("\nq.jpg 1 0 0 0 4 5 6\n"));
  const std::string json = ReadFile(output_ / "results.jsonl");
  EXPECT_LT(json.find("q.jpg"), json.find("r.jpg")) << "sorted by name";
}

TEST_F(ResultWriterTest, ModelReadsBackWithTheSameBits) {
  Write();
  const Model model = ReadModel(output_ / "model");
  ASSERT_EQ(model.images.size(), 3);
  for (size_t i = 0; i < model_.images.size(); ++i) {
    EXPECT_EQ(model.images[i].name, model_.images[i].name);
    EXPECT_EQ(model.images[i].image_id, model_.images[i].image_id);
    EXPECT_EQ(model.images[i].cam_from_world.rotation.coeffs(), model_.images[i].cam_from_world.rotation.coeffs());
    EXPECT_EQ(model.images[i].cam_from_world.translation, model_.images[i].cam_from_world.translation);
  }
  EXPECT_EQ(model.images[2].name, "q.jpg");
  EXPECT_EQ(model.images[2].image_id, 3);
  EXPECT_EQ(model.cameras.at(1).params, model_.cameras.at(1).params);
}

TEST_F(ResultWriterTest, ModelHasKeypointsOfQueriesAndObservedImagesOnly) {
  Write();
  const auto image_bytes = [](size_t num_points) {
    return 4 + 7 * 8 + 4 + std::string("a.jpg").size() + 1 + 8 + 24 * num_points;
  };
  EXPECT_EQ(fs::file_size(output_ / "model" / "images.bin"), 8 + image_bytes(2) + image_bytes(0) + image_bytes(2));
  // The one point has id, xyz, black, error, and a track of the query's second and a.jpg's first keypoint.
  const std::string points = ReadFile(output_ / "model" / "points3D.bin");
  ASSERT_EQ(points.size(), 8 + 8 + 24 + 3 + 8 + 8 + 2 * 8);
  EXPECT_EQ(points.substr(points.size() - 16), std::string("\3\0\0\0\1\0\0\0\1\0\0\0\0\0\0\0", 16));
  EXPECT_EQ(points.substr(40, 3), std::string(3, '\0'));
}

TEST_F(ResultWriterTest, SameInputSameBytesInAnyOrder) {
  Write();
  const auto first = Contents(output_);
  std::swap(records_[0], records_[1]);
  Write();
  EXPECT_EQ(Contents(output_), first);
}

TEST_F(ResultWriterTest, ReplacesAnEarlierRunAsAWhole) {
  Write();
  const auto fresh = Contents(output_);
  for (const char* stale : {"model/rigs.bin", "model/frames.bin", "poses.txt"}) {
    std::ofstream(output_ / stale) << "stale";
  }
  Write();
  EXPECT_EQ(Contents(output_), fresh);
}

TEST_F(ResultWriterTest, SummaryOfLeaveOneOutIsThatOfTheLastRun) {
  Write(/*is_leave_one_out=*/true);
  EXPECT_TRUE(fs::exists(output_ / "leave_one_out.json"));
  Write(/*is_leave_one_out=*/false);
  EXPECT_FALSE(fs::exists(output_ / "leave_one_out.json"));
}

TEST_F(ResultWriterTest, MapIsThatOfTheLastRun) {
  model_.axes.geographic_origin = {47, 8, 400};
  Write();
  EXPECT_TRUE(fs::exists(output_ / "positions.geojson"));
  EXPECT_EQ(ReadModel(output_ / "model").axes.geographic_origin->height_m, 400);
  model_.axes = {std::nullopt, /*are_arbitrary=*/true};
  Write();
  EXPECT_FALSE(fs::exists(output_ / "positions.geojson"));
  EXPECT_FALSE(ReadModel(output_ / "model").axes.geographic_origin.has_value());
  EXPECT_TRUE(ReadModel(output_ / "model").axes.are_arbitrary);
}

TEST_F(ResultWriterTest, PhotoWithoutKeypointsMayBeLocalizedByItsRig) {
  records_[1].result.query_name = "sky.jpg";
  records_[1].result.points.clear();
  Write();
  EXPECT_THAT(ReadFile(output_ / "model" / "images.bin"), ::testing::HasSubstr("sky.jpg"));
}

TEST_F(ResultWriterTest, PosesOfRigsAreThoseOfTheLastRun) {
  records_[1].result.frame_name = "moment 1";
  Write();
  EXPECT_TRUE(fs::exists(output_ / "rig_poses.txt"));
  records_[1].result.frame_name.clear();
  Write();
  EXPECT_FALSE(fs::exists(output_ / "rig_poses.txt"));
}

TEST_F(ResultWriterTest, LeavesFilesOfTheUserAlone) {
  fs::create_directory(output_);
  std::ofstream(output_ / "notes.md") << "mine";
  Write();
  EXPECT_EQ(ReadFile(output_ / "notes.md"), "mine");
}

TEST_F(ResultWriterTest, ModelThatNoRunHasWrittenIsNotReplaced) {
  fs::create_directories(output_ / "model");
  EXPECT_THAT(ErrorOfConstruction(output_), StartsWith("out/model: would be replaced"));
  EXPECT_THAT(Names(output_), ElementsAre("model"));
}

TEST_F(ResultWriterTest, WithoutWriteNothingIsLeft) {
  { ResultWriter writer(output_ / "deep" / "er"); }
  EXPECT_FALSE(fs::exists(output_));
  fs::create_directory(output_);
  { ResultWriter writer(output_); }
  EXPECT_TRUE(fs::exists(output_)) << "it was there before";
  EXPECT_THAT(Names(output_), IsEmpty());
}

TEST_F(ResultWriterTest, FailedWriteLeavesTheEarlierRun) {
  Write();
  const auto before = Contents(output_);
  records_[1].result.cam_from_world.translation.setZero();
  MakeDatabase(folder_ / "damaged.db", "UPDATE keypoints SET data = zeroblob(3) WHERE image_id = 1");
  const DatabaseReader damaged(folder_ / "damaged.db");
  EXPECT_THAT(ErrorOf([&] {
                ResultWriter writer(output_);
                writer.Write(model_, Stored(records_), {damaged, damaged.ReadImages()}, "other", nullptr);
              }),
              StartsWith("damaged.db"));
  EXPECT_EQ(Contents(output_), before);
}

TEST_F(ResultWriterTest, FolderThatGoesAwayDuringTheRunIsReported) {
  Write();
  const auto before = Contents(output_);
  records_[1].result.cam_from_world.translation.setZero();
  const DatabaseReader database(database_path_);
  EXPECT_THAT(ErrorOf([&] {
                ResultWriter writer(output_);
                fs::rename(output_, folder_ / "moved");
                writer.Write(model_, Stored(records_), {database, database.ReadImages()}, "other", nullptr);
              }),
              StartsWith("out: cannot be written into"));
  EXPECT_EQ(Contents(folder_ / "moved"), before);
}

TEST_F(ResultWriterTest, RefusesWhatCannotBeWrittenInto) {
  WriteFile("file", "");
  EXPECT_THAT(ErrorOfConstruction(folder_ / "file"), StartsWith("file: is not a folder"));
  EXPECT_THAT(ErrorOfConstruction(folder_ / "file" / "below"), StartsWith("file/below: the folder cannot be made"));
  EXPECT_THAT(ErrorOfConstruction(""), HasSubstr("the folder cannot be made"));
  if (!fs::exists("/proc/self")) return;
  EXPECT_THAT(ErrorOfConstruction("/proc/x"), StartsWith("/proc/x: the folder cannot be made"));
  EXPECT_THAT(ErrorOfConstruction("/proc"), StartsWith("/proc: cannot be written into"));
}

}  // namespace
}  // namespace lazyloc

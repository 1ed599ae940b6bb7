#include "colmap_lazyloc/runs/query_records.h"

#include <limits>

#include <gmock/gmock.h>

#include "colmap_lazyloc/runs/records_test_fixture.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::StartsWith;

// Returns a record whose fields all differ from their defaults.
QueryRecord FullRecord(const std::string& name) {
  QueryRecord record;
  LocalizationResult& result = record.result;
  result.query_name = name;
  result.status = QueryStatus::SCALE_UNOBSERVABLE;
  result.reason = "one sentence";
  result.query_camera = {7, 4, 640, 480, {500.5, 320, 1.0 / 3}, true};
  result.is_camera_refined = true;
  result.intrinsics = {IntrinsicsOrigin::EXIF, IntrinsicsVerdict::REFINED, 1.25, 0.5, "contradicted"};
  result.frame_name = "frame";
  result.rig_error_px = 2.5;
  result.cam_from_world = {Eigen::Quaterniond(0.1, 0.2, 0.3, 0.4), {1, 2, std::numeric_limits<double>::quiet_NaN()}};
  result.rig_from_world.translation.x() = -0.0;
  result.rig_scale = 3;
  for (int i = 0; i < 36; ++i) result.covariance(i / 6, i % 6) = i / 7.0;
  result.spread = {0.25, {3, 2, 1}, {0, 1, 0}};
  result.confidence = 0.75;
  result.evidence.explained_ratio = 0.5;
  result.runner_up = RunnerUp{"another place", {Eigen::Quaterniond(1, 2, 3, 4), {1, 2, 3}}, 0.5};
  result.partial_pose = PartialPose{Eigen::Quaterniond(1, 2, 3, 4), 0.5, Bearing{"from", {0, 0, 1}, 0.1}};
  result.start = "motion_averaging";
  result.pairs = {{"a.jpg", 42, 0.5, std::numeric_limits<double>::quiet_NaN()}};
  result.points = {{{7, 8, 9}, 3, {{0, 5}, {1, 6}}, 0.5}};
  result.num_tracks = 11;
  result.num_observations = 12;
  result.mean_reprojection_error_px = 0.75;
  result.seconds = {{"rotation", 0.5}};
  record.keypoints = {{1.5, 2.5}, {3.5, 4.5}};
  record.seconds = {{"load", 0.25}, {"rotation", 0.5}};
  record.total_seconds = 1.75;
  record.intrinsics_source = IntrinsicsSource::EXIF;
  record.matcher = MatcherType::SIFT_BRUTEFORCE;
  return record;
}

class QueryRecordsTest : public RecordsTest {
 protected:
  std::filesystem::path WriteGroups(const std::string& name,
                                    const std::vector<std::vector<QueryRecord>>& groups) const {
    RecordWriter writer(folder_ / name);
    for (size_t i = 0; i < groups.size(); ++i) writer.Append(PackGroup(i, groups[i]));
    return folder_ / name;
  }
};

TEST_F(QueryRecordsTest, EveryBitReadsBack) {
  const QueryRecord record = FullRecord("q");
  const QueryRecords records({WriteGroups("a.bin", {{QueryRecord(), record}})});
  const QueryRecord read = records.Read(*records.Find("q"), RecordParts::ALL);
  // Compares all fields by their bytes, which the archive's list of members makes complete.
  EXPECT_EQ(PackGroup(0, {read}), PackGroup(0, {record}));
  EXPECT_EQ(read.result.partial_pose->bearing->database_name, "from");
  EXPECT_TRUE(std::signbit(read.result.rig_from_world.translation.x()));
  EXPECT_TRUE(std::isnan(read.result.cam_from_world.translation.z()));
  EXPECT_EQ(read.result.points[0].observations[1].second, 6);
  EXPECT_EQ(read.keypoints[1].y(), 4.5);
  EXPECT_EQ(read.total_seconds, 1.75);
}

TEST_F(QueryRecordsTest, PartsThatAreNotWantedAreEmpty) {
  const QueryRecords records = Stored({FullRecord("q")});
  EXPECT_TRUE(records.Read(0, RecordParts::HEAD).keypoints.empty());
  const QueryRecord with_keypoints = records.Read(0, RecordParts::KEYPOINTS);
  EXPECT_EQ(with_keypoints.keypoints.size(), 2u);
  EXPECT_TRUE(with_keypoints.result.points.empty());
}

TEST_F(QueryRecordsTest, AreSortedByNameOverFilesAndGroups) {
  const auto first = WriteGroups("a.bin", {{FullRecord("c"), FullRecord("a")}, {FullRecord("e")}});
  const auto second = WriteGroups("b.bin", {{FullRecord("b")}, {FullRecord("d")}});
  const QueryRecords records({first, WriteGroups("empty.bin", {}), second});
  std::vector<std::string> names;
  records.ForEach([&](const QueryRecord& record) { names.push_back(record.result.query_name); });
  EXPECT_THAT(names, ElementsAre("a", "b", "c", "d", "e"));
  EXPECT_THAT(records.CountByFile(), ElementsAre(3, 0, 2));
  EXPECT_EQ(records.Find("c"), 2u);
  EXPECT_FALSE(records.Find("bb").has_value());
  EXPECT_FALSE(records.Find("").has_value());
}

TEST_F(QueryRecordsTest, ManyFilesNeedNoOpenFileEach) {
  std::vector<std::filesystem::path> paths;
  for (int i = 0; i < 1200; ++i) {
    paths.push_back(WriteGroups(std::to_string(i), {{FullRecord("q" + std::to_string(10000 + i))}}));
  }
  const QueryRecords records(paths);
  for (const size_t i : {0, 700, 1199, 3, 600}) {
    EXPECT_EQ(records.Read(i, RecordParts::HEAD).result.query_name, "q" + std::to_string(10000 + i));
  }
}

TEST_F(QueryRecordsTest, DoubledQueryAndDamageAreNamed) {
  const auto first = WriteGroups("a.bin", {{FullRecord("q")}}), second = WriteGroups("b.bin", {{FullRecord("q")}});
  EXPECT_THAT(ErrorOf([&] { QueryRecords({first, second}); }), ::testing::HasSubstr("query q has two records"));
  WriteFile("a.bin", ReadFile(first) + "x");
  EXPECT_THAT(ErrorOf([&] { QueryRecords({first}); }), StartsWith("a.bin: is damaged from byte "));
  EXPECT_THAT(ErrorOf([&] { QueryRecords({folder_ / "none"}); }), StartsWith("none: cannot be opened"));
}

}  // namespace
}  // namespace lazyloc

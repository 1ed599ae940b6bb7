#include "colmap_lazyloc/queries/query_record.h"

#include <gmock/gmock.h>

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::Pair;

LocalizationResult MakeResult(const std::string& name, const StageTimer::Seconds& seconds) {
  LocalizationResult result;
  result.query_name = name;
  result.seconds = seconds;
  return result;
}

TEST(FinishRecords, JoinsLoadingAndPipelineAndSumsStagesThatRanTwice) {
  LoadedGroup loaded;
  loaded.group.images.resize(2);
  loaded.records.resize(2);
  loaded.records[0].keypoints = {{1, 2}};
  loaded.records[0].seconds = {{"load", 1}};
  loaded.records[1].seconds = {{"load", 2}};
  loaded.failures.resize(1);
  loaded.failures[0].result.query_name = "failed";
  loaded.failures[0].seconds = {{"extraction", 3}};
  loaded.start -= std::chrono::seconds(30);
  const std::vector<QueryRecord> records = FinishRecords(
      loaded,
      {MakeResult("a", {{"two_view", 0.25}, {"tracks", 0.5}, {"two_view", 1}}), MakeResult("b", {{"load", 1}})});
  ASSERT_EQ(records.size(), 3u);
  EXPECT_EQ(records[0].result.query_name, "failed");
  EXPECT_THAT(records[0].seconds, ElementsAre(Pair("extraction", 3)));
  EXPECT_EQ(records[1].result.query_name, "a");
  EXPECT_EQ(records[1].keypoints.size(), 1u);
  EXPECT_THAT(records[1].seconds, ElementsAre(Pair("load", 1), Pair("two_view", 1.25), Pair("tracks", 0.5)));
  EXPECT_EQ(records[2].result.query_name, "b");
  EXPECT_THAT(records[2].seconds, ElementsAre(Pair("load", 3)));
  for (const QueryRecord& record : records) {
    EXPECT_GE(record.total_seconds, 10) << "each has a third of the group's 30 seconds";
    EXPECT_LT(record.total_seconds, 30);
  }
}

TEST(FinishRecords, SaysWhatWasLeftOut) {
  LoadedGroup loaded;
  loaded.group.images.resize(3);
  loaded.records.resize(3);
  for (QueryRecord& record : loaded.records) record.damages = {"table a, image 1: bad"};
  loaded.records[1].damages.emplace_back("table a, image 2: bad");
  std::vector<LocalizationResult> results(3);
  results[0].status = QueryStatus::NO_PAIRS;
  results[1].status = QueryStatus::TOO_FEW_TRACKS;
  results[1].reason = "only 2 tracks";
  results[2].status = QueryStatus::LOCALIZED;
  const std::vector<QueryRecord> records = FinishRecords(loaded, results);
  EXPECT_EQ(records[0].result.status, QueryStatus::DAMAGED_DATA);
  EXPECT_EQ(records[0].result.reason, "left out: table a, image 1: bad");
  EXPECT_EQ(records[1].result.status, QueryStatus::TOO_FEW_TRACKS);
  EXPECT_EQ(records[1].result.reason, "only 2 tracks; left out: table a, image 1: bad (2 damaged records)");
  EXPECT_EQ(records[2].result.reason, "");
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/runs/unfinished_run.h"

#include <gmock/gmock.h>

#include "colmap_lazyloc/runs/query_records.h"
#include "colmap_lazyloc/runs/shard_folders.h"
#include "colmap_lazyloc/testing/io_test.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::StartsWith;

QueryRecord RecordOf(const std::string& name) {
  QueryRecord record;
  record.result.query_name = name;
  return record;
}

class UnfinishedRunTest : public IoTest {
 protected:
  UnfinishedRunTest() {
    fs::create_directory(output_);
    manifest_.program = "program 1";
    manifest_.options = {{"seed", "0"}, {"ratio", "0.8"}};
    manifest_.inputs = {{"database_path", {"a.db", {"5 bytes", "1:2", "3"}}}};
    manifest_.num_groups = 3;
    manifest_.num_queries = manifest_.num_own_queries = 4;
  }
  void RunOneGroup() { UnfinishedRun(output_, manifest_, RunStart::NEW).Append(1, {RecordOf("a"), RecordOf("b")}); }
  std::string ErrorOfResuming() {
    return ErrorOf([&] { UnfinishedRun(output_, manifest_, RunStart::RESUME); });
  }

  const fs::path output_ = folder_ / "out";
  RunManifest manifest_;
};

TEST_F(UnfinishedRunTest, GoesOnWhereItEnded) {
  RunOneGroup();
  UnfinishedRun run(output_, manifest_, RunStart::RESUME);
  EXPECT_FALSE(run.IsDone(0));
  EXPECT_TRUE(run.IsDone(1));
  EXPECT_EQ(run.NumQueriesDone(), 2u);
  run.Append(0, {RecordOf("c")});
  EXPECT_EQ(QueryRecords({run.RecordsPath()}).Size(), 3u);
  run.Finish();
  EXPECT_FALSE(fs::exists(run.Folder()));
}

TEST_F(UnfinishedRunTest, IsSaidToBeUnfinished) {
  RunOneGroup();
  EXPECT_THAT(ErrorOf([&] { UnfinishedRun::CheckStart(output_, RunStart::NEW); }),
              StartsWith("out/unfinished: an unfinished run, 2 of 4 queries done: go on with --resume 1"));
  EXPECT_THAT(ErrorOf([&] { UnfinishedRun(output_, manifest_, RunStart::NEW); }), HasSubstr("an unfinished run"));
  UnfinishedRun run(output_, manifest_, RunStart::OVERWRITE);
  EXPECT_FALSE(run.IsDone(1));
}

TEST_F(UnfinishedRunTest, LeavesNothingWithoutAFinishedGroup) {
  { UnfinishedRun run(output_, manifest_, RunStart::NEW); }
  EXPECT_TRUE(fs::is_empty(output_));
}

TEST_F(UnfinishedRunTest, RefusesWhatHasChanged) {
  RunOneGroup();
  const RunManifest same = manifest_;
  manifest_.options[1].second = "0.9";
  EXPECT_THAT(ErrorOfResuming(), HasSubstr("because option --ratio is '0.9' and was '0.8'"));
  manifest_ = same;
  manifest_.program = "program 2";
  EXPECT_THAT(ErrorOfResuming(), HasSubstr("the program is program 2 and was program 1"));
  manifest_ = same;
  manifest_.inputs["database_path"].fingerprint.content = "6 bytes";
  EXPECT_THAT(ErrorOfResuming(), HasSubstr("a.db (--database_path) has changed"));
  manifest_ = same;
  manifest_.inputs["pairs_path"] = {"p.txt", {}};
  EXPECT_THAT(ErrorOfResuming(), HasSubstr("option --pairs_path is 'p.txt' and was not given"));
  manifest_ = same;
  manifest_.inputs.clear();
  EXPECT_THAT(ErrorOfResuming(), HasSubstr("option --database_path is not given and was 'a.db'"));
  manifest_ = same;
  manifest_.shard = Shard{1, 2};
  EXPECT_THAT(ErrorOfResuming(), HasSubstr("option --shard is '1/2' and was ''"));
  manifest_ = same;
  manifest_.num_groups = 5;
  EXPECT_THAT(ErrorOfResuming(), HasSubstr("there are 4 queries in 5 groups"));
  manifest_ = same;
  EXPECT_EQ(ErrorOfResuming(), "");
}

TEST_F(UnfinishedRunTest, CopyMayHaveOtherTimesButTheSameFileMayNot) {
  RunOneGroup();
  Fingerprint& fingerprint = manifest_.inputs["database_path"].fingerprint;
  fingerprint.modified = "4";
  EXPECT_THAT(ErrorOfResuming(), HasSubstr("has changed"));
  fingerprint.identity = "another machine";
  EXPECT_EQ(ErrorOfResuming(), "");
}

TEST_F(UnfinishedRunTest, DamagedManifestIsNamed) {
  RunOneGroup();
  WriteFile("out/unfinished/manifest.json", "{");
  EXPECT_THAT(ErrorOfResuming(), StartsWith("out/unfinished/manifest.json: is not a manifest"));
}

TEST_F(UnfinishedRunTest, RestOfAKilledProcessIsRemoved) {
  RunOneGroup();
  fs::create_directories(output_ / "unfinished" / "staging" / "new");
  const UnfinishedRun run(output_, manifest_, RunStart::RESUME);
  EXPECT_FALSE(fs::exists(output_ / "unfinished" / "staging"));
}

TEST_F(UnfinishedRunTest, ShardKeepsItsRecords) {
  manifest_.shard = Shard{2, 3};
  {
    UnfinishedRun run(output_, manifest_, RunStart::NEW);
    EXPECT_FALSE(UnfinishedRun::FinishedShard(output_).has_value());
    run.Finish();
  }
  EXPECT_EQ(UnfinishedRun::FinishedShard(output_)->shard->Text(), "2/3");
  EXPECT_TRUE(fs::exists(output_ / "shard" / "records.bin"));
}

TEST_F(UnfinishedRunTest, ManifestOfAShardMustNameIt) {
  fs::create_directories(output_ / "shard");
  WriteFile("out/shard/manifest.json", manifest_.ToJson());
  EXPECT_THAT(ErrorOf([&] { UnfinishedRun::FinishedShard(output_); }),
              StartsWith("out/shard/manifest.json: is the manifest of a run without shards"));
}

TEST(ParseShard, TakesTwoNumbersFromOne) {
  EXPECT_EQ(ParseShard("17/256")->Text(), "17/256");
  for (const char* text : {"", "1", "0/3", "4/3", "1/", "/3", "1/3x", "-1/3", "1/3/4", " 1/3"}) {
    EXPECT_FALSE(ParseShard(text).has_value()) << text;
  }
}

TEST(Shard, EveryNameIsInOneAndAllHaveSome) {
  std::vector<int> counts(7);
  for (int i = 0; i < 700; ++i) {
    int num_shards = 0;
    for (uint32_t shard = 1; shard <= 7; ++shard) {
      if (!Shard{shard, 7}.Has("query/" + std::to_string(i))) continue;
      ++num_shards;
      ++counts[shard - 1];
    }
    EXPECT_EQ(num_shards, 1);
  }
  for (const int count : counts) EXPECT_GT(count, 60);
}

TEST(Shard, IsTheSameOnEveryMachine) { EXPECT_TRUE((Shard{0xCBF43926u % 97 + 1, 97}.Has("123456789"))); }

TEST(AsRanges, JoinsNeighbours) {
  EXPECT_EQ(AsRanges({3, 7, 8, 9}), "3,7-9");
  EXPECT_EQ(AsRanges({1, 2}), "1-2");
  EXPECT_EQ(AsRanges({5}), "5");
}

class FingerprintTest : public IoTest {};

TEST_F(FingerprintTest, TellsEveryChangeOfASmallFile) {
  const fs::path path = WriteFile("a", std::string(100000, 'x'));
  const Fingerprint before = FingerprintOf(path);
  EXPECT_FALSE(FingerprintOf(path).IsChanged(before));
  std::string bytes(100000, 'x');
  bytes[99999] = 'y';
  WriteFile("a", bytes);
  EXPECT_TRUE(FingerprintOf(path).IsChanged(before));
}

TEST_F(FingerprintTest, TellsChangesOfALargeFileByItsTime) {
  const fs::path path = WriteFile("a", std::string(20 << 20, 'x'));
  const Fingerprint before = FingerprintOf(path);
  EXPECT_FALSE(before.identity.empty());
  fs::last_write_time(path, fs::last_write_time(path) + std::chrono::seconds(1));
  EXPECT_TRUE(FingerprintOf(path).IsChanged(before));
  fs::copy_file(path, folder_ / "copy");
  EXPECT_FALSE(FingerprintOf(folder_ / "copy").IsChanged(before)) << "a copy";
}

TEST_F(FingerprintTest, OfAFolderIsThatOfItsFiles) {
  fs::create_directory(folder_ / "model");
  WriteFile("model/a", "1");
  const Fingerprint before = FingerprintOf(folder_ / "model");
  WriteFile("model/b", "2");
  EXPECT_TRUE(FingerprintOf(folder_ / "model").IsChanged(before));
  EXPECT_EQ(FingerprintOf(folder_ / "none").content, "");
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/files/staged_output.h"

#include <gmock/gmock.h>

#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/testing/test_folder.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

class StagedOutputTest : public ::testing::Test {
 protected:
  StagedOutputTest() { WriteBytes(folder_ / "a", "old a"); }

  size_t NumEntries() const {
    return static_cast<size_t>(std::distance(fs::directory_iterator(folder_.Path()), fs::directory_iterator()));
  }

  TestFolder folder_;
};

TEST_F(StagedOutputTest, ReplacesFilesAndFoldersAtTheEnd) {
  {
    StagedOutput staged(folder_.Path());
    WriteBytes(staged / "a", "new a");
    fs::create_directory(staged / "b");
    WriteBytes(staged / "b" / "c", "new c");
    EXPECT_EQ(ReadBytes(folder_ / "a"), "old a");
    staged.Publish({"a", "b"});
  }
  EXPECT_EQ(ReadBytes(folder_ / "a"), "new a");
  EXPECT_EQ(ReadBytes(folder_ / "b" / "c"), "new c");
  EXPECT_EQ(NumEntries(), 2u);
}

TEST_F(StagedOutputTest, WithoutPublishNothingChanges) {
  {
    const StagedOutput staged(folder_.Path());
    WriteBytes(staged / "a", "new a");
  }
  EXPECT_EQ(ReadBytes(folder_ / "a"), "old a");
  EXPECT_EQ(NumEntries(), 1u);
}

TEST_F(StagedOutputTest, FailureRestoresEveryEntry) {
  {
    StagedOutput staged(folder_.Path());
    WriteBytes(staged / "a", "new a");
    EXPECT_THAT(
        [&] {
          staged.Publish({"a", "never_written"});
        },
        ThrowsMessage<InputError>(HasSubstr("never_written: cannot be replaced")));
  }
  EXPECT_EQ(ReadBytes(folder_ / "a"), "old a");
  EXPECT_EQ(NumEntries(), 1u);
}

TEST_F(StagedOutputTest, TwoRunsDoNotShareTheirFiles) {
  StagedOutput first(folder_.Path()), second(folder_.Path());
  WriteBytes(first / "a", "first");
  WriteBytes(second / "a", "second");
  first.Publish({"a"});
  EXPECT_EQ(ReadBytes(folder_ / "a"), "first");
  second.Publish({"a"});
  EXPECT_EQ(ReadBytes(folder_ / "a"), "second");
}

TEST_F(StagedOutputTest, MissingFolderIsAnError) {
  EXPECT_THAT([&] { StagedOutput(folder_ / "missing"); },
              ThrowsMessage<InputError>(HasSubstr("missing: cannot be written into: ")));
  EXPECT_THAT([&] { StagedOutput(folder_ / "missing", "a.db"); },
              ThrowsMessage<InputError>(HasSubstr("a.db: cannot be written: ")));
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/database/sqlite.h"

#include <chrono>
#include <filesystem>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/testing/test_database.h"
#include "colmap_lazyloc/testing/test_folder.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

// Returns the one line that a user gets to see.
template <typename Function>
std::string InputErrorOf(const Function& function) {
  try {
    function();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), Not(HasSubstr("\n")));
    return error.what();
  }
  return "no error";
}

std::string OpeningError(const fs::path& path) {
  return InputErrorOf([&] { DatabaseReader reader(path); });
}

constexpr int kNumImages = 200;

// Creates a database that is large enough for many pages.
void CreateDatabase(TestDatabase* database) {
  database->Execute("BEGIN");
  for (int i = 1; i <= kNumImages; ++i) {
    database->AddImage(i, 1, std::to_string(i) + ".jpg");
    database->AddKeypoints(i, std::vector<Eigen::Vector2d>(50, {i, 2 * i}));
    if (i > 1) database->AddMatches(i, 1, {{5, 6}});
  }
  database->Execute("COMMIT");
}

void CreateDatabase(const fs::path& path) {
  TestDatabase database(path, TestDatabase::Schema::V3_10);
  CreateDatabase(&database);
}

// Leaves a database like a crash of COLMAP: the last changes are in the WAL only.
void CreateCrashedDatabase(const TestFolder& folder, const std::string& name) {
  const fs::path live = folder / "live.db";
  {
    TestDatabase database(live, TestDatabase::Schema::V4_2);
    database.Execute("PRAGMA wal_autocheckpoint=0; PRAGMA wal_checkpoint");
    CreateDatabase(&database);
    fs::copy_file(live, folder / name);
    fs::copy_file(live.string() + "-wal", folder / (name + "-wal"));
  }
  fs::remove(live);
}

void ReadEverything(const fs::path& path) {
  const DatabaseReader reader(path);
  ASSERT_EQ(reader.ReadImages().size(), static_cast<size_t>(kNumImages));
  for (int i = 1; i <= kNumImages; ++i) {
    ASSERT_EQ(reader.ReadKeypoints(i).at(49), Eigen::Vector2d(i, 2 * i));
  }
  ASSERT_EQ(reader.ReadMatchCounts(1, {2, kNumImages}).size(), 2u);
}

TEST(ReadOnly, WalModeDatabaseAndItsFolderAreUnchanged) {
  const TestFolder folder;
  CreateDatabase(folder / "a.db");
  EXPECT_EQ(ReadBytes(folder / "a.db")[18], 2) << "not in WAL mode";
  const FolderState before = ReadFolderState(folder.Path());
  ReadEverything(folder / "a.db");
  EXPECT_EQ(ReadFolderState(folder.Path()), before);
}

TEST(ReadOnly, JournalModeDatabaseAndItsFolderAreUnchanged) {
  const TestFolder folder;
  {
    TestDatabase database(folder / "a.db", TestDatabase::Schema::V3_8);
    CreateDatabase(&database);
    database.Execute("PRAGMA journal_mode=PERSIST; DELETE FROM matches WHERE rows = 0");
    database.Execute("DELETE FROM cameras");
  }
  const FolderState before = ReadFolderState(folder.Path());
  ReadEverything(folder / "a.db");
  EXPECT_EQ(ReadFolderState(folder.Path()), before);
}

TEST(ReadOnly, ReadOnlyFolderIsEnough) {
  const TestFolder folder;
  CreateDatabase(folder / "a.db");
  fs::permissions(folder / "a.db", fs::perms::owner_read);
  fs::permissions(folder.Path(), fs::perms::owner_read | fs::perms::owner_exec);
  const FolderState before = ReadFolderState(folder.Path());
  ReadEverything(folder / "a.db");
  EXPECT_EQ(ReadFolderState(folder.Path()), before);
}

TEST(ReadOnly, PendingWalIsReadAndUnchanged) {
  const TestFolder folder;
  CreateCrashedDatabase(folder, "a.db");
  const FolderState before = ReadFolderState(folder.Path());
  ASSERT_EQ(before.size(), 3u);
  ReadEverything(folder / "a.db");
  EXPECT_EQ(ReadFolderState(folder.Path()), before);
}

TEST(ReadOnly, PendingWalInReadOnlyFolderIsRead) {
  const TestFolder folder;
  CreateCrashedDatabase(folder, "a.db");
  fs::permissions(folder / "a.db", fs::perms::owner_read);
  fs::permissions(folder / "a.db-wal", fs::perms::owner_read);
  fs::permissions(folder.Path(), fs::perms::owner_read | fs::perms::owner_exec);
  const FolderState before = ReadFolderState(folder.Path());
  ReadEverything(folder / "a.db");
  EXPECT_EQ(ReadFolderState(folder.Path()), before);
}

TEST(ReadOnly, PendingWalIsFoundBehindALink) {
  const TestFolder folder;
  CreateCrashedDatabase(folder, "a.db");
  fs::create_directory(folder / "links");
  fs::create_symlink("../a.db", folder / "links/b.db");
  ReadEverything(folder / "links/b.db");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder / "links"), {}), 1);
}

TEST(ReadOnly, EmptyWalIsNoMatter) {
  const TestFolder folder;
  CreateDatabase(folder / "a.db");
  WriteBytes(folder / "a.db-wal", "");
  const FolderState before = ReadFolderState(folder.Path());
  ReadEverything(folder / "a.db");
  EXPECT_EQ(ReadFolderState(folder.Path()), before);
}

// Reads a database that COLMAP has open, with its own -wal and -shm.
TEST(ReadOnly, OpenDatabaseIsReadAndUnchanged) {
  const TestFolder folder;
  TestDatabase database(folder / "a.db", TestDatabase::Schema::V3_10);
  CreateDatabase(&database);
  const FolderState before = ReadFolderState(folder.Path());
  ASSERT_EQ(before.count("a.db-shm"), 1u);
  ReadEverything(folder / "a.db");
  EXPECT_EQ(ReadFolderState(folder.Path()), before);
  database.Execute("DELETE FROM matches");  // no lock stays behind
}

TEST(ReadOnly, ChangeByOthersIsNoticed) {
  const TestFolder folder;
  for (const bool is_pending : {false, true}) {
    const fs::path path = folder / (is_pending ? "pending.db" : "a.db");
    TestDatabase database(path, TestDatabase::Schema::V3_10);
    if (!is_pending) database.Execute("PRAGMA journal_mode=DELETE");
    CreateDatabase(&database);
    // File times are coarse: make sure that the next write has another one.
    for (const auto& entry : fs::directory_iterator(folder.Path())) {
      fs::last_write_time(entry, entry.last_write_time() - std::chrono::seconds(10));
    }
    const DatabaseReader reader(path);
    EXPECT_EQ(reader.ReadKeypoints(7).size(), 50u);
    database.Execute("UPDATE keypoints SET rows = 49");
    EXPECT_EQ(InputErrorOf([&] { reader.ReadKeypoints(150); }),
              path.string() + ": was changed by another program while it was being read");
  }
}

TEST(Path, SpecialCharactersAreTakenLiterally) {
  const TestFolder folder;
  for (const std::string name : {"a b.db", "a#b?c%41&d=e.db", "Zür ich\xE2\x82\xAC.db", "a'b\"c;d.db", "file:x.db"}) {
    CreateDatabase(folder / name);
    const FolderState before = ReadFolderState(folder.Path());
    ReadEverything(folder / name);
    EXPECT_EQ(ReadFolderState(folder.Path()), before) << name;
  }
}

TEST(Path, RelativeAndLinkedPathsWork) {
  const TestFolder folder;
  CreateDatabase(folder / "a.db");
  ReadEverything(fs::relative(folder / "a.db"));
  fs::create_symlink(folder / "a.db", folder / "link");
  EXPECT_EQ(DatabaseReader(folder / "link").Path(), folder / "link");
}

TEST(BadFile, MissingFileIsNamedAndNotCreated) {
  const TestFolder folder;
  EXPECT_EQ(OpeningError(folder / "no.db"), (folder / "no.db").string() + ": does not exist");
  EXPECT_TRUE(fs::is_empty(folder.Path()));
  EXPECT_THAT(OpeningError(folder / "no/such/file.db"), HasSubstr("file.db: does not exist"));
  EXPECT_THAT(OpeningError(""), HasSubstr("does not exist"));
}

TEST(BadFile, FolderEmptyAndForeignFilesAreNamed) {
  const TestFolder folder;
  EXPECT_EQ(OpeningError(folder.Path()), folder.Path().string() + ": is a folder, not a database");
  const fs::path file = folder / "file";
  WriteBytes(file, "");
  EXPECT_EQ(OpeningError(file), file.string() + ": is empty, not a COLMAP database");
  WriteBytes(file, "# Camera list with one line of data per camera:\n" + std::string(1000, 'x'));
  EXPECT_EQ(OpeningError(file), file.string() + ": is not a SQLite database");
  WriteBytes(file, "SQL");
  EXPECT_EQ(OpeningError(file), file.string() + ": is not a SQLite database");
  EXPECT_THAT(OpeningError("/dev/null"), StartsWith("/dev/null: is not a regular file"));
}

TEST(BadFile, TruncatedFileIsNoticedAtOpening) {
  const TestFolder folder;
  CreateDatabase(folder / "a.db");
  const std::string bytes = ReadBytes(folder / "a.db");
  for (const size_t size : {size_t{50}, size_t{100}, size_t{4096}, bytes.size() / 2, bytes.size() - 1}) {
    WriteBytes(folder / "cut.db", bytes.substr(0, size));
    EXPECT_THAT(OpeningError(folder / "cut.db"), StartsWith((folder / "cut.db").string() + ": is truncated: "));
  }
}

// Damage anywhere gives an InputError, or nothing if nobody reads those bytes, but never a crash.
TEST(BadFile, DamagedPagesGiveOneLineWithThePath) {
  const TestFolder folder;
  CreateDatabase(folder / "a.db");
  const std::string bytes = ReadBytes(folder / "a.db");
  const fs::path path = folder / "damaged.db";
  int num_errors = 0;
  for (size_t offset = 0; offset < bytes.size(); offset += 4096) {
    std::string damaged = bytes;
    damaged.replace(offset + 100, 3996, 3996, static_cast<char>(0xA5));
    damaged[offset] = offset == 0 ? damaged[0] : static_cast<char>(0xA5);
    WriteBytes(path, damaged);
    const std::string error = InputErrorOf([&] {
      const DatabaseReader reader(path);
      reader.ReadImages();
      for (int i = 1; i <= kNumImages; ++i) reader.ReadKeypoints(i);
      reader.ReadMatchCounts(1, {2, kNumImages});
      reader.ReadMatches(1, 2);
    });
    if (error == "no error") continue;
    EXPECT_THAT(error, StartsWith(path.string() + ": "));
    ++num_errors;
  }
  EXPECT_GT(num_errors, 10);
}

TEST(BadFile, RollbackJournalIsRefusedAndUnchanged) {
  const TestFolder folder;
  CreateDatabase(folder / "a.db");
  WriteBytes(folder / "a.db-journal", "\xd9\xd5\x05\xf9\x20\xa1\x63\xd7" + std::string(600, 'x'));
  const FolderState before = ReadFolderState(folder.Path());
  EXPECT_THAT(OpeningError(folder / "a.db"),
              AllOf(StartsWith((folder / "a.db").string() + ": has an unfinished transaction"), HasSubstr("-journal")));
  EXPECT_EQ(ReadFolderState(folder.Path()), before);
  WriteBytes(folder / "a.db-journal", std::string(600, '\0'));  // as journal_mode=PERSIST leaves it
  EXPECT_EQ(OpeningError(folder / "a.db"), "no error");
}

TEST(BadFile, MissingTableOrColumnIsNamed) {
  const TestFolder folder;
  for (const std::string table : {"cameras", "images", "keypoints", "matches", "two_view_geometries"}) {
    const fs::path path = folder / (table + ".db");
    TestDatabase(path, TestDatabase::Schema::V3_10).Execute("DROP TABLE " + table);
    EXPECT_EQ(OpeningError(path), path.string() + ": is not a COLMAP database: it has no table " + table);
  }
  const fs::path path = folder / "column.db";
  TestDatabase(path, TestDatabase::Schema::V3_10).Execute("ALTER TABLE cameras RENAME COLUMN model TO type");
  EXPECT_EQ(OpeningError(path), path.string() + ": is not a COLMAP database: its table cameras has no column model");
}

}  // namespace
}  // namespace lazyloc

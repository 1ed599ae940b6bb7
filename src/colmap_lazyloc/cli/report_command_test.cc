#include "colmap_lazyloc/cli/report_command.h"

#include <cstdlib>
#include <filesystem>

#include <gmock/gmock.h>

#include "colmap_lazyloc/testing/test_folder.h"

namespace lazyloc {
namespace {

TEST(ReportCommand, NamesWhatTheRunHasRead) {
  CommandOptions options;
  options.output_path = "localized";
  options.source.database_path = "database.db";
  EXPECT_EQ(ReportCommand("lazyloc", options),
            "lazyloc report localized --database_path database.db --output localized/report.html");
  options.source.photos.image_path = "photos";
  EXPECT_EQ(ReportCommand("lazyloc", options),
            "lazyloc report localized --image_path photos --database_path database.db "
            "--output localized/report.html");
}

TEST(ReportCommand, QuotesPathsForTheShell) {
  CommandOptions options;
  options.output_path = "it's $HOME/";
  options.source.database_path = "my database.db";
  EXPECT_EQ(ReportCommand("lazyloc", options),
            "lazyloc report 'it'\\''s $HOME/' --database_path 'my database.db' "
            "--output 'it'\\''s $HOME/report.html'");
}

TEST(FindLazyloc, LooksInPathAndBesideTheProgram) {
  const TestFolder folder;
  const std::string lazyloc = folder / "lazyloc", own_path = folder / "colmap";
  const auto find = [](const std::string& program, const std::string& search_path) {
    const std::string before = std::getenv("PATH");
    setenv("PATH", search_path.c_str(), 1);
    const std::string found = FindLazyloc(program);
    setenv("PATH", before.c_str(), 1);
    return found;
  };
  EXPECT_EQ(find(own_path, "/none"), "");
  WriteBytes(lazyloc, "#!/bin/sh\n");
  EXPECT_EQ(find(own_path, "/none"), "") << "it cannot be run";
  std::filesystem::permissions(lazyloc, std::filesystem::perms::owner_all);
  EXPECT_EQ(find(own_path, "/none"), lazyloc);
  EXPECT_EQ(find(own_path, "/none:" + folder.Path().string()), "lazyloc");
  EXPECT_EQ(find(folder / "build/bin/colmap", "/none"), "");
  std::filesystem::create_directory(folder / "scripts");
  std::filesystem::rename(lazyloc, folder / "scripts/lazyloc");
  EXPECT_EQ(find(folder / "build/bin/colmap", "/none"), (folder / "scripts/lazyloc").string());
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/cli/report_command.h"

#include <gmock/gmock.h>

namespace lazyloc {
namespace {

using testing::MatchesRegex;

TEST(ReportCommand, NamesWhatTheRunHasRead) {
  CommandOptions options;
  options.output_path = "localized";
  options.source.database_path = "database.db";
  EXPECT_EQ(ReportCommand(options),
            "python -m colmap_lazyloc.report localized --database_path database.db --output localized/report.html");
  options.source.photos.image_path = "photos";
  EXPECT_EQ(ReportCommand(options),
            "python -m colmap_lazyloc.report localized --image_path photos --database_path database.db "
            "--output localized/report.html");
}

TEST(ReportCommand, QuotesPathsForTheShell) {
  CommandOptions options;
  options.output_path = "it's $HOME/";
  options.source.database_path = "my database.db";
  EXPECT_EQ(ReportCommand(options),
            "python -m colmap_lazyloc.report 'it'\\''s $HOME/' --database_path 'my database.db' "
            "--output 'it'\\''s $HOME/report.html'");
}

TEST(ProgramVersion, NamesBothPrograms) {
  EXPECT_THAT(ProgramVersion(), MatchesRegex("colmap_lazyloc [0-9]+\\.[0-9]+\\.[0-9]+, COLMAP [34]\\.[0-9]+.*"));
}

}  // namespace
}  // namespace lazyloc

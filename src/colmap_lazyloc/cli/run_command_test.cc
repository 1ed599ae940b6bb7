#include "colmap_lazyloc/cli/run_command.h"

#include <cstdlib>
#include <stdexcept>

#include <gtest/gtest.h>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

using ::testing::internal::CaptureStderr;
using ::testing::internal::GetCapturedStderr;

TEST(RunCommand, ErrorsAreOneLineWhateverNamesTheyHold) {
  CaptureStderr();
  EXPECT_EQ(RunCommand("test", []() -> int { throw InputError("caf\xC3\xA9\n\x1B[2J\x7F.jpg: is missing"); }),
            EXIT_FAILURE);
  EXPECT_EQ(GetCapturedStderr(), "ERROR: caf\xC3\xA9\\n\\x1b[2J\\x7f.jpg: is missing\n");
  CaptureStderr();
  EXPECT_EQ(RunCommand("test", []() -> int { throw std::logic_error("two\nlines"); }), EXIT_FAILURE);
  EXPECT_EQ(GetCapturedStderr(), "ERROR (a bug in test, please report it): two\\nlines\n");
}

TEST(RunCommand, ReturnsTheExitCode) {
  EXPECT_EQ(RunCommand("test", [] { return 130; }), 130);
}

TEST(PrintWarning, IsOneLine) {
  CaptureStderr();
  PrintWarning("a\r\nb");
  EXPECT_EQ(GetCapturedStderr(), "WARNING: a\\x0d\\nb\n");
}

}  // namespace
}  // namespace lazyloc

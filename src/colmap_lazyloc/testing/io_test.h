#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include <gtest/gtest.h>

#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/testing/test_folder.h"

namespace lazyloc {

// A fixture for tests that read and write files in a folder of their own.
class IoTest : public ::testing::Test {
 protected:
  std::filesystem::path WriteFile(const std::string& name, const std::string& content) const {
    WriteBytes(folder_ / name, content);
    return folder_ / name;
  }
  static std::string ReadFile(const std::filesystem::path& path) { return ReadBytes(path); }

  // Returns the message of the InputError that the action throws, without the test's folder at its front; empty if it
  // throws none.
  std::string ErrorOf(const std::function<void()>& action) const {
    try {
      action();
    } catch (const InputError& error) {
      const std::string message = error.what(), prefix = folder_.string() + "/";
      EXPECT_EQ(message.find('\n'), std::string::npos) << message;
      return message.rfind(prefix, 0) == 0 ? message.substr(prefix.size()) : message;
    }
    return "";
  }

 private:
  const TestFolder test_folder_;

 protected:
  const std::filesystem::path folder_ = test_folder_.Path();
};

}  // namespace lazyloc

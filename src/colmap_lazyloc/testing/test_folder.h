#pragma once

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <string>
#include <utility>

#include <gtest/gtest.h>

namespace lazyloc {

inline std::string ReadBytes(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

inline void WriteBytes(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

// State of a folder that a reader must not change: names, bytes and modification times of its files, and the
// modification time of the folder itself.
using FolderState = std::map<std::string, std::pair<std::string, std::filesystem::file_time_type>>;
inline FolderState ReadFolderState(const std::filesystem::path& folder) {
  FolderState state = {{".", {"", std::filesystem::last_write_time(folder)}}};
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string bytes = entry.is_regular_file() ? ReadBytes(entry.path()) : "";
    state[entry.path().filename().string()] = {bytes, entry.last_write_time()};
  }
  return state;
}

// Empty folder for the running test. The destructor removes it.
class TestFolder {
 public:
  TestFolder() {
    std::string name = ::testing::UnitTest::GetInstance()->current_test_info()->name();
    for (char& c : name) c = c == '/' ? '-' : c;
    path_ = std::filesystem::path(::testing::TempDir()) / (name + "-" + std::to_string(getpid()));
    std::filesystem::remove_all(path_);
    std::filesystem::create_directories(path_);
  }
  ~TestFolder() {
    std::error_code ignored;
    std::filesystem::permissions(path_, std::filesystem::perms::owner_all, ignored);
    std::filesystem::remove_all(path_, ignored);
  }
  TestFolder(const TestFolder&) = delete;
  TestFolder& operator=(const TestFolder&) = delete;

  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  const std::filesystem::path& Path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace lazyloc

#pragma once

#include <filesystem>
#include <system_error>

namespace lazyloc {

// True if there is something at the path, for example a file, a folder, or a link to nothing.
inline bool IsTaken(const std::filesystem::path& path) {
  std::error_code ignored;
  return std::filesystem::exists(std::filesystem::symlink_status(path, ignored));
}

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

namespace lazyloc {

// Maximum number of pixels of a depth map: a larger size is that of a damaged file.
inline constexpr size_t kMaxNumDepthPixels = 1 << 28;

// Pixels of a 16-bit grey PNG, row by row from the upper left.
struct GreyPng {
  int width = 0;
  int height = 0;
  std::vector<uint16_t> values;
};

// Reads a 16-bit grey PNG by libpng, because COLMAP reduces images to 8 bits. Throws InputError naming the file.
GreyPng ReadGreyPng(const std::filesystem::path& path);

}  // namespace lazyloc

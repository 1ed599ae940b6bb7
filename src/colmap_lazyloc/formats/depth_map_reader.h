#pragma once

#include <filesystem>
#include <vector>

namespace lazyloc {

// Depths of an image's pixels along its optical axis, row by row from the upper left; 0: unknown.
struct DepthMap {
  int width = 0;
  int height = 0;
  std::vector<float> depths;

  float At(int x, int y) const { return depths[static_cast<size_t>(y) * width + x]; }
};

// Reads a 16-bit grey PNG, a NumPy array of float16, float32 or float64, or a map of COLMAP's dense stereo, by the
// ending of the name. png_unit: database units per value of a PNG, where 65535 means unknown like 0. Values that are
// negative or not finite become unknown. Throws InputError naming the file if it cannot be used.
DepthMap ReadDepthMap(const std::filesystem::path& path, double png_unit);

}  // namespace lazyloc

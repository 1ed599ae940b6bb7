#include "colmap_lazyloc/formats/depth_map_reader.h"

#include <cmath>
#include <limits>
#include <regex>
#include <string>

#include <Eigen/Core>

#include "colmap_lazyloc/files/binary_file.h"
#include "colmap_lazyloc/formats/png_reader.h"

namespace lazyloc {
namespace {

float KnownDepth(double value) { return std::isfinite(value) && value > 0 ? static_cast<float>(value) : 0; }

DepthMap ReadPng(const std::filesystem::path& path, double unit) {
  const GreyPng image = ReadGreyPng(path);
  DepthMap map{image.width, image.height, {}};
  map.depths.reserve(image.values.size());
  for (const uint16_t value : image.values) {
    map.depths.push_back(value == std::numeric_limits<uint16_t>::max() ? 0 : KnownDepth(unit * value));
  }
  return map;
}

// Reads the depths of a map of a size that the file states, up to its end.
template <typename Read>
DepthMap ReadDepths(uint64_t width, uint64_t height, const Read& read, const BinaryFile& file) {
  if (width == 0 || height == 0 || width > kMaxNumDepthPixels / height) throw file.Error("has an impossible size");
  DepthMap map{static_cast<int>(width), static_cast<int>(height), {}};
  map.depths.reserve(width * height);
  for (uint64_t i = 0; i < width * height; ++i) map.depths.push_back(KnownDepth(read()));
  file.CheckEnd();
  return map;
}

// Reads COLMAP's format: `width&height&1&` as text, then float32 values.
DepthMap ReadColmap(const std::filesystem::path& path) {
  BinaryFile file(path);
  uint64_t sizes[3];
  for (uint64_t& size : sizes) {
    size = 0;
    int num_digits = 0;
    for (char c = file.Read<char>(); c != '&'; c = file.Read<char>()) {
      if (c < '0' || c > '9' || ++num_digits > 9) throw file.Error("not a depth map of COLMAP");
      size = 10 * size + static_cast<uint64_t>(c - '0');
    }
  }
  if (sizes[2] != 1) throw file.Error("not a depth map of COLMAP: it has " + std::to_string(sizes[2]) + " channels");
  return ReadDepths(
      sizes[0], sizes[1], [&] { return file.Read<float>(); }, file);
}

DepthMap ReadNumpy(const std::filesystem::path& path) {
  BinaryFile file(path);
  for (const char expected : {'\x93', 'N', 'U', 'M', 'P', 'Y'}) {
    if (file.Read<char>() != expected) throw file.Error("not a NumPy file");
  }
  const uint8_t version = file.Read<uint8_t>();
  file.Read<uint8_t>();
  const uint32_t size = version == 1 ? file.Read<uint16_t>() : file.Read<uint32_t>();
  std::string text;
  for (uint32_t i = 0; i < size; ++i) text.push_back(file.Read<char>());
  // The shape may have axes of length 1 around rows and columns.
  static const std::regex kDescription(
      R"(.*'descr': *'<(f[248])'.*'fortran_order': *False.*'shape': *\((?:1, *)?(\d{1,9}), *(\d{1,9})(?:, *1)?,?\).*)");
  std::smatch found;
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  if (!std::regex_match(text, found, kDescription)) {
    throw file.Error("not a depth map: it must be an array of rows and columns of float16, float32 or float64");
  }
  const auto read = [&, type = found[1].str()]() -> double {
    if (type == "f2") return static_cast<float>(Eigen::numext::bit_cast<Eigen::half>(file.Read<uint16_t>()));
    return type == "f4" ? file.Read<float>() : file.Read<double>();
  };
  return ReadDepths(std::stoull(found[3]), std::stoull(found[2]), read, file);
}

}  // namespace

DepthMap ReadDepthMap(const std::filesystem::path& path, double png_unit) {
  const std::string ending = path.extension().string();
  if (ending == ".png") return ReadPng(path, png_unit);
  return ending == ".npy" ? ReadNumpy(path) : ReadColmap(path);
}

}  // namespace lazyloc

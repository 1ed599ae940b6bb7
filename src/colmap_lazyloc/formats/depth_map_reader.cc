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

// Makes an empty map of a size that a file states.
DepthMap MakeMap(uint64_t width, uint64_t height, const BinaryFile& file) {
  if (width == 0 || height == 0 || width > kMaxNumDepthPixels / height) throw file.Error("has an impossible size");
  DepthMap map{static_cast<int>(width), static_cast<int>(height), {}};
  map.depths.reserve(width * height);
  return map;
}

template <typename Read>
void ReadDepths(const Read& read, DepthMap* map) {
  const size_t num_pixels = static_cast<size_t>(map->width) * map->height;
  for (size_t i = 0; i < num_pixels; ++i) map->depths.push_back(KnownDepth(read()));
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
  DepthMap map = MakeMap(sizes[0], sizes[1], file);
  ReadDepths([&] { return static_cast<double>(file.Read<float>()); }, &map);
  file.CheckEnd();
  return map;
}

// What the header of a NumPy file says.
struct NumpyHeader {
  std::string type;  // f2, f4 or f8
  uint64_t height = 0, width = 0;
};

NumpyHeader ReadNumpyHeader(BinaryFile* file) {
  for (const char expected : {'\x93', 'N', 'U', 'M', 'P', 'Y'}) {
    if (file->Read<char>() != expected) throw file->Error("not a NumPy file");
  }
  const uint8_t version = file->Read<uint8_t>();
  file->Read<uint8_t>();
  const uint32_t size = version == 1 ? file->Read<uint16_t>() : file->Read<uint32_t>();
  std::string text;
  for (uint32_t i = 0; i < size; ++i) text.push_back(file->Read<char>());
  // The shape may have axes of length 1 around rows and columns.
  static const std::regex kDescription(
      R"(.*'descr': *'<(f[248])'.*'fortran_order': *False.*'shape': *\((?:1, *)?(\d{1,9}), *(\d{1,9})(?:, *1)?,?\).*)");
  std::smatch found;
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  if (!std::regex_match(text, found, kDescription)) {
    throw file->Error("not a depth map: it must be an array of rows and columns of float16, float32 or float64");
  }
  return {found[1], std::stoull(found[2]), std::stoull(found[3])};
}

DepthMap ReadNumpy(const std::filesystem::path& path) {
  BinaryFile file(path);
  const NumpyHeader header = ReadNumpyHeader(&file);
  DepthMap map = MakeMap(header.width, header.height, file);
  if (header.type == "f2") {
    ReadDepths([&] { return static_cast<float>(Eigen::numext::bit_cast<Eigen::half>(file.Read<uint16_t>())); }, &map);
  } else if (header.type == "f4") {
    ReadDepths([&] { return static_cast<double>(file.Read<float>()); }, &map);
  } else {
    ReadDepths([&] { return file.Read<double>(); }, &map);
  }
  file.CheckEnd();
  return map;
}

}  // namespace

DepthMap ReadDepthMap(const std::filesystem::path& path, double png_unit) {
  const std::string ending = path.extension().string();
  if (ending == ".png") return ReadPng(path, png_unit);
  return ending == ".npy" ? ReadNumpy(path) : ReadColmap(path);
}

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>
#include <unordered_map>

#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

class TextFile;

// Reads the cameras and images of a COLMAP model folder (cameras.bin and images.bin, else the .txt files, as in
// COLMAP), its rigs and frames if it has any, and its origin on Earth (formats/geo_file.h) if it has one. Skips image
// points and points3D, which need not exist. Throws InputError naming the file if it is missing, truncated or not of
// this format, and for a camera model that the linked COLMAP does not know, impossible parameters, a pose with NaN or a
// zero quaternion, duplicate names or ids, an image whose camera is missing, and a model without a posed image.
Model ReadModel(const std::filesystem::path& path);

// Place of an image's points in images.bin or images.txt: x, y and POINT3D_ID of each, 24 bytes or three words.
struct PointsPlace {
  uint64_t offset = 0;
  uint64_t num_bytes = 0;
};

using PointsPlaces = std::unordered_map<uint32_t, PointsPlace>;  // by image id

// A model that may have no images, and where the points of its images are.
struct ModelOnDisk {
  Model model;
  std::filesystem::path images_path;
  PointsPlaces points;
};
// Reads a model like ReadModel, but not its origin on Earth.
ModelOnDisk ReadModelWithPoints(const std::filesystem::path& path);

// Parses the rest of a line, `width height params...`, for a camera of a model.
Camera ParseCamera(int model_id, std::string_view rest, const TextFile& file);

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// COLMAP's options and defaults of SIFT on the CPU.
struct SiftExtractionOptions {
  int max_image_size = 3200;    // a larger image is scaled down
  int max_num_features = 8192;  // those of the largest scales are kept
  int first_octave = -1;        // -1 doubles the image's size first
  double peak_threshold = 0.02 / 3;
  double edge_threshold = 10;
  bool estimate_affine_shape = false;
  bool domain_size_pooling = false;
  bool upright = false;

  bool Check(std::string* error) const;
};

struct Photo {
  uint64_t width = 0;  // of the file, in pixels
  uint64_t height = 0;
  std::optional<double> exif_focal_length_px;
  Features features;  // in pixels of the file
};

// Reads an image file and extracts its features as COLMAP's feature_extractor does. None where it is no image that
// COLMAP can read. Thread-safe; uses one thread.
std::optional<Photo> ReadPhoto(const std::filesystem::path& path, const SiftExtractionOptions& options);

}  // namespace lazyloc

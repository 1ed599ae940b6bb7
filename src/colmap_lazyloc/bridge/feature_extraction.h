#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// Options of COLMAP's SIFT extraction on the CPU, with COLMAP's defaults.
struct SiftExtractionOptions {
  int max_image_size = 3200;    // in pixels, of the longer side; larger images are scaled down
  int max_num_features = 8192;  // the features with the largest scales are kept
  int first_octave = -1;        // -1: doubles the size of the image first
  double peak_threshold = 0.02 / 3;
  double edge_threshold = 10;
  bool estimate_affine_shape = false;
  bool domain_size_pooling = false;
  bool upright = false;

  bool Check(std::string* error) const;
};

// Image file with its features.
struct Photo {
  uint64_t width = 0;  // of the file, in pixels, before scaling down
  uint64_t height = 0;
  std::optional<double> exif_focal_length_px;
  Features features;  // keypoints in pixels of the file
};

// Reads an image file and extracts its features like COLMAP's feature_extractor. Returns nullopt if COLMAP cannot read
// the file as an image; returns no features if the image is too small. Thread-safe; uses one thread.
std::optional<Photo> ReadPhoto(const std::filesystem::path& path, const SiftExtractionOptions& options);

}  // namespace lazyloc

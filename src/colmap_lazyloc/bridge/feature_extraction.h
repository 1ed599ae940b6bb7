#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "colmap_lazyloc/math/parallel_for.h"
#include "colmap_lazyloc/scene/features.h"

namespace colmap {
class Bitmap;
}

namespace lazyloc {

constexpr int kDefaultMaxNumFeatures = 8192;  // COLMAP's

// Options of COLMAP's SIFT extraction on the CPU, with COLMAP's defaults.
struct SiftExtractionOptions {
  // Values that matching/feature_statistics.h replaces by those of the database images.
  static constexpr int kLikeDatabase = -1, kOctaveLikeDatabase = -2;

  int max_image_size = 3200;                      // in pixels, of the longer side; larger images are scaled down
  int max_num_features = kDefaultMaxNumFeatures;  // the features with the largest scales are kept
  int first_octave = -1;                          // -1: doubles the size of the image first
  bool estimate_affine_shape = false;
  bool domain_size_pooling = false;
  bool upright = false;
  bool turns_photos = false;  // turns photos upright by EXIF before extraction, as COLMAP does from 4.0 on

  bool Check(std::string* error) const;
};

// What an image file tells about its camera.
struct PhotoProperties {
  uint64_t width = 0;  // of the pixels as stored, whatever the orientation in EXIF
  uint64_t height = 0;
  std::optional<double> exif_focal_length_px;
  std::string exif_camera;   // make and model; empty if unknown
  int quarter_turns = 0;     // that make the stored pixels upright, by EXIF (scene/quarter_turns.h)
  bool is_mirrored = false;  // true if the stored pixels are a mirror image, by EXIF
};

// Pixels row by row, with three values each.
struct RgbImage {
  int width = 0, height = 0;
  std::vector<uint8_t> values;
};

// An image file in memory. A copy shares the pixels.
class PhotoFile {
 public:
  // Returns nullopt if COLMAP cannot read the file as an image. Keeps colours only if asked to.
  static std::optional<PhotoFile> Read(const std::filesystem::path& path, bool as_rgb = false);
  // Reads an image for coarse features, in grey, with a longer side of at most max_size. Takes a fraction of the time
  // for large JPEG files, whose properties are then those of a smaller one.
  static std::optional<PhotoFile> ReadReduced(const std::filesystem::path& path, int max_size);
  // Makes the file that COLMAP would read from a lossless image without EXIF. values: rows of pixels, of one (grey) or
  // three (RGB) values each.
  static PhotoFile FromPixels(const uint8_t* values, int width, int height, int num_channels);

  const PhotoProperties& Properties() const { return properties_; }
  // Extracts features like COLMAP's feature_extractor, with keypoints in pixels of the file as stored. Returns none if
  // the image is too small. No option may follow the database. Thread-safe. Uses idle threads, too, except for affine
  // shapes and domain-size pooling.
  Features ExtractFeatures(const SiftExtractionOptions& options, IdleThreads* idle_threads) const;
  // Returns the pixels, scaled down to a longer side of at most max_size and then turned upright, like COLMAP 4's
  // feature extraction.
  RgbImage ToRgb(int max_size) const;

 private:
  PhotoProperties properties_;
  std::shared_ptr<const colmap::Bitmap> pixels_;
};

// Returns make and model from COLMAP's name of a camera in EXIF, `make-model-focal length-width x height`.
std::string ExifMakeAndModel(const std::string& colmap_name);

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <colmap/feature/sift.h>
#include <colmap/feature/types.h>
#include <colmap/sensor/bitmap.h>

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// COLMAP's defaults, for what SiftExtractionOptions leaves out.
inline const colmap::SiftExtractionOptions kColmapSift;

// Extracts features by COLMAP's extractor, in pixels of the bitmap, without scaling it. Returns false if the bitmap is
// too small for COLMAP.
bool ExtractSift(const colmap::Bitmap& bitmap, const SiftExtractionOptions& options,
                 colmap::FeatureKeypoints* keypoints, Descriptors* descriptors);

// Extracts the features that COLMAP extracts without affine shapes and domain-size pooling, faster. grey: width *
// height values, row by row. Keypoints are in pixels of the image. Uses idle threads, too; the result does not depend
// on them.
void ExtractPlainSift(const std::vector<uint8_t>& grey, int width, int height, const SiftExtractionOptions& options,
                      IdleThreads* idle_threads, colmap::FeatureKeypoints* keypoints, Descriptors* descriptors);

// Returns the options for ExtractPlainSift; nullopt if COLMAP extracts other features with these.
std::optional<SiftExtractionOptions> PlainSiftOptions(const colmap::SiftExtractionOptions& options);

// Returns the values of a grey bitmap, row by row.
std::vector<uint8_t> GreyValues(const colmap::Bitmap& bitmap);
// Returns the values of a bitmap in colours, row by row: red, green and blue of each pixel.
std::vector<uint8_t> RgbValues(const colmap::Bitmap& bitmap);

// Reads an image as COLMAP does, and with COLMAP 3 also colours of 16 bits, which COLMAP 4 reads. Returns false if it
// cannot be read.
bool ReadImage(const std::filesystem::path& path, bool as_rgb, colmap::Bitmap* bitmap);

// Reads an image in grey, with a longer side of at least `size` if the file has it. Returns false if COLMAP cannot read
// the file. Reads JPEG files at an eighth, a quarter or half of their size, in a fraction of the time, with COLMAP 3.
bool ReadReduced(const std::filesystem::path& path, int size, colmap::Bitmap* bitmap);

// Returns a black bitmap.
colmap::Bitmap AllocateBitmap(int width, int height, bool as_rgb);

// Turns a bitmap counter-clockwise, by 1 to 3 quarter turns.
void Turn(int quarter_turns, colmap::Bitmap* bitmap);

// Returns a number of EXIF by the name of its tag, such as PixelXDimension or Orientation; nullopt if EXIF has none.
std::optional<double> ExifNumber(const colmap::Bitmap& bitmap, const std::string& tag);
// Returns the focal length of EXIF in pixels, nullopt if EXIF has no positive one.
std::optional<double> ExifFocalLengthPx(const colmap::Bitmap& bitmap);
// Returns COLMAP's name of the camera in EXIF; empty if EXIF lacks the make, the model or the focal length.
std::string ExifCameraName(const colmap::Bitmap& bitmap);

inline void CopyOptions(const SiftExtractionOptions& options, colmap::SiftExtractionOptions* converted) {
  converted->max_num_features = options.max_num_features;
  converted->first_octave = options.first_octave;
  converted->estimate_affine_shape = options.estimate_affine_shape;
  converted->domain_size_pooling = options.domain_size_pooling;
  converted->upright = options.upright;
}

}  // namespace lazyloc

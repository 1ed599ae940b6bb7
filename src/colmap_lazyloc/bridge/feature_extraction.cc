#include "colmap_lazyloc/bridge/feature_extraction.h"

#include <algorithm>
#include <cmath>
#include <system_error>
#include <utility>

#include "colmap_lazyloc/bridge/sift.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/options_check.h"
#include "colmap_lazyloc/scene/quarter_turns.h"

namespace lazyloc {
namespace {

// round: rounds the new size like COLMAP's feature extraction, so that keypoints are the same.
void ScaleDown(int max_size, double (*round)(double), colmap::Bitmap* bitmap) {
  const int size = std::max(bitmap->Width(), bitmap->Height());
  if (size <= max_size) return;
  const double scale = static_cast<double>(max_size) / size;
  bitmap->Rescale(std::max(1, static_cast<int>(round(bitmap->Width() * scale))),
                  std::max(1, static_cast<int>(round(bitmap->Height() * scale))));
}

// Maximum ratios of what two values of EXIF say if they agree. Zooms and sides of an image are rounded; a focal length
// for a film of 35 mm means the film's width to some and its diagonal to others, and has no decimals.
constexpr double kMaxSizeRatio = 1.05, kMaxFocalLengthRatio = 1.25;

double RatioAboveOne(double a, double b) { return std::max(a, b) / std::min(a, b); }

// Returns the number of units of EXIF's FocalPlaneResolutionUnit in a millimetre; 0 for unknown ones.
double UnitsPerMm(double unit) {
  switch (static_cast<int>(unit)) {
    case 2: return 1 / 25.4;  // inches
    case 3: return 1 / 10.0;  // centimetres
    case 4: return 1;
    case 5: return 1000;
    default: return 0;
  }
}

// Returns the focal length of EXIF in pixels, by COLMAP's rule; nullopt if EXIF has none, or contradicts it.
std::optional<double> ConsistentFocalLengthPx(const colmap::Bitmap& bitmap) {
  const std::optional<double> focal_length_px = ExifFocalLengthPx(bitmap);
  if (!focal_length_px) return std::nullopt;
  const auto value = [&bitmap](const char* tag) { return ExifNumber(bitmap, tag).value_or(0); };
  // A focal length for a film of 35 mm has the digital zoom in it with some cameras, and not with others.
  if (value("DigitalZoomRatio") > kMaxSizeRatio) return std::nullopt;
  // EXIF outlives editing: of a photo of another shape, a part was cut out. Turned photos have their sides exchanged.
  const double x = value("PixelXDimension"), y = value("PixelYDimension");
  const double size = std::max(bitmap.Width(), bitmap.Height()), other_size = std::min(bitmap.Width(), bitmap.Height());
  const bool has_size = x > 0 && y > 0;
  if (has_size && RatioAboveOne(RatioAboveOne(x, y), size / other_size) > kMaxSizeRatio) return std::nullopt;
  const double scale = has_size ? size / std::max(x, y) : 1;
  const double by_sensor_px =
      value("FocalLength") * value("FocalPlaneXResolution") * UnitsPerMm(value("FocalPlaneResolutionUnit")) * scale;
  if (by_sensor_px > 0 && RatioAboveOne(by_sensor_px, *focal_length_px) > kMaxFocalLengthRatio) return std::nullopt;
  return focal_length_px;
}

// COLMAP's own check throws an exception for a file that cannot be looked up, for example a link to itself.
bool IsFile(const std::filesystem::path& path) {
  std::error_code error;
  return std::filesystem::is_regular_file(path, error);
}

}  // namespace

bool SiftExtractionOptions::Check(std::string* error) const {
  OPTION_GE(max_image_size, 1);
  OPTION_GE(max_num_features, kLikeDatabase);
  if (max_num_features == 0) {
    *error = "max_num_features must be >= 1, or -1 for as many as the database images have";
    return false;
  }
  OPTION_GE(first_octave, kOctaveLikeDatabase);
  return true;
}

std::string ExifMakeAndModel(const std::string& colmap_name) {
  const size_t size = colmap_name.rfind('-');
  const size_t focal_length = size == std::string::npos || size == 0 ? size : colmap_name.rfind('-', size - 1);
  return focal_length == std::string::npos ? "" : colmap_name.substr(0, focal_length);
}

std::optional<PhotoFile> PhotoFile::Read(const std::filesystem::path& path, bool as_rgb) {
  auto bitmap = std::make_shared<colmap::Bitmap>();
  if (!IsFile(path) || !ReadImage(path, as_rgb, bitmap.get())) return std::nullopt;
  const int orientation = static_cast<int>(ExifNumber(*bitmap, "Orientation").value_or(0));
  PhotoFile file;
  file.properties_ = {static_cast<uint64_t>(bitmap->Width()),
                      static_cast<uint64_t>(bitmap->Height()),
                      ConsistentFocalLengthPx(*bitmap),
                      ExifMakeAndModel(ExifCameraName(*bitmap)),
                      TurnsOfExif(orientation),
                      IsMirrored(orientation)};
  file.pixels_ = std::move(bitmap);
  return file;
}

std::optional<PhotoFile> PhotoFile::ReadReduced(const std::filesystem::path& path, int max_size) {
  auto bitmap = std::make_shared<colmap::Bitmap>();
  if (!IsFile(path) || !lazyloc::ReadReduced(path, max_size, bitmap.get())) return std::nullopt;
  ScaleDown(max_size, &std::round, bitmap.get());
  PhotoFile file;
  file.properties_.width = static_cast<uint64_t>(bitmap->Width());
  file.properties_.height = static_cast<uint64_t>(bitmap->Height());
  file.pixels_ = std::move(bitmap);
  return file;
}

PhotoFile PhotoFile::FromPixels(const uint8_t* values, int width, int height, int num_channels) {
  const bool is_rgb = num_channels == 3;
  colmap::Bitmap bitmap = AllocateBitmap(width, height, is_rgb);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x, values += num_channels) {
      using Color = colmap::BitmapColor<uint8_t>;
      bitmap.SetPixel(x, y, is_rgb ? Color(values[0], values[1], values[2]) : Color(values[0]));
    }
  }
  PhotoFile file;
  file.properties_.width = static_cast<uint64_t>(width);
  file.properties_.height = static_cast<uint64_t>(height);
  file.pixels_ = std::make_shared<const colmap::Bitmap>(std::move(bitmap));
  return file;
}

Features PhotoFile::ExtractFeatures(const SiftExtractionOptions& options, IdleThreads* idle_threads) const {
  LAZYLOC_CHECK(options.max_num_features > 0 && options.first_octave >= -1);
  colmap::Bitmap bitmap = pixels_->IsRGB() ? pixels_->CloneAsGrey() : *pixels_;
  ScaleDown(options.max_image_size, &std::trunc, &bitmap);
  const auto stored_width = static_cast<float>(bitmap.Width()), stored_height = static_cast<float>(bitmap.Height());
  const int quarter_turns = options.turns_photos ? properties_.quarter_turns : 0;
  if (quarter_turns > 0) Turn(quarter_turns, &bitmap);
  Features features;
  colmap::FeatureKeypoints keypoints;
  if (!options.estimate_affine_shape && !options.domain_size_pooling) {
    ExtractPlainSift(GreyValues(bitmap), bitmap.Width(), bitmap.Height(), options, idle_threads, &keypoints,
                     &features.descriptors);
  } else if (!ExtractSift(bitmap, options, &keypoints, &features.descriptors)) {
    return features;  // image too small
  }
  const float scale_x = static_cast<float>(properties_.width) / stored_width;
  const float scale_y = static_cast<float>(properties_.height) / stored_height;
  for (const auto& [x, y, a11, a12, a21, a22] : keypoints) {
    features.keypoints.push_back(Scaled(Turned({x, y, a11, a12, a21, a22}, TurnsBack(quarter_turns),
                                               static_cast<float>(bitmap.Width()), static_cast<float>(bitmap.Height())),
                                        scale_x, scale_y));
  }
  return features;
}

RgbImage PhotoFile::ToRgb(int max_size) const {
  colmap::Bitmap bitmap = pixels_->IsRGB() ? *pixels_ : pixels_->CloneAsRGB();
  ScaleDown(max_size, &std::round, &bitmap);
  if (properties_.quarter_turns > 0) Turn(properties_.quarter_turns, &bitmap);
  return {bitmap.Width(), bitmap.Height(), RgbValues(bitmap)};
}

}  // namespace lazyloc

#include "colmap_lazyloc/bridge/sift.h"

#include <colmap/feature/extractor.h>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

bool ExtractSift(const colmap::Bitmap& bitmap, const SiftExtractionOptions& options,
                 colmap::FeatureKeypoints* keypoints, Descriptors* descriptors) {
  colmap::FeatureExtractionOptions converted(colmap::FeatureExtractorType::SIFT);
  converted.use_gpu = false;
  converted.num_threads = 1;
  converted.max_image_size = options.max_image_size;
  CopyOptions(options, converted.sift.get());
  const auto extractor = colmap::FeatureExtractor::Create(converted);
  LAZYLOC_CHECK(extractor != nullptr);
  colmap::FeatureDescriptors extracted;
  if (!extractor->Extract(bitmap, keypoints, &extracted)) return false;
  *descriptors = std::move(extracted.data);
  return true;
}

std::vector<uint8_t> GreyValues(const colmap::Bitmap& bitmap) { return bitmap.RowMajorData(); }

std::vector<uint8_t> RgbValues(const colmap::Bitmap& bitmap) { return bitmap.RowMajorData(); }

bool ReadImage(const std::filesystem::path& path, bool as_rgb, colmap::Bitmap* bitmap) {
  return bitmap->Read(path.string(), as_rgb);
}

bool ReadReduced(const std::filesystem::path& path, int, colmap::Bitmap* bitmap) {
  return ReadImage(path, /*as_rgb=*/false, bitmap);
}

colmap::Bitmap AllocateBitmap(int width, int height, bool as_rgb) { return colmap::Bitmap(width, height, as_rgb); }

void Turn(int quarter_turns, colmap::Bitmap* bitmap) { bitmap->Rot90(quarter_turns); }

std::optional<double> ExifNumber(const colmap::Bitmap& bitmap, const std::string& tag) {
  float value = 0;
  const bool is_found = bitmap.GetMetaData(tag, "float", &value) || bitmap.GetMetaData("Exif:" + tag, "float", &value);
  return is_found ? std::make_optional<double>(value) : std::nullopt;
}

std::optional<double> ExifFocalLengthPx(const colmap::Bitmap& bitmap) {
  const std::optional<double> focal_length = bitmap.ExifFocalLength();
  return focal_length.value_or(0) > 0 ? focal_length : std::nullopt;
}

std::string ExifCameraName(const colmap::Bitmap& bitmap) { return bitmap.ExifCameraModel().value_or(""); }

}  // namespace lazyloc

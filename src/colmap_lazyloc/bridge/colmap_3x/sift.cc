#include "colmap_lazyloc/bridge/sift.h"

#include <mutex>

#include <FreeImage.h>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Guards the conversion of EXIF's values to text, for which FreeImage has one buffer for all threads.
std::mutex exif_mutex;

}  // namespace

bool ExtractSift(const colmap::Bitmap& bitmap, const SiftExtractionOptions& options,
                 colmap::FeatureKeypoints* keypoints, Descriptors* descriptors) {
  colmap::SiftExtractionOptions converted;
  converted.use_gpu = false;
  converted.num_threads = 1;
  converted.max_image_size = options.max_image_size;
  CopyOptions(options, &converted);
  const auto extractor = colmap::CreateSiftFeatureExtractor(converted);
  LAZYLOC_CHECK(extractor != nullptr);
  return extractor->Extract(bitmap, keypoints, descriptors);
}

std::vector<uint8_t> GreyValues(const colmap::Bitmap& bitmap) { return bitmap.ConvertToRowMajorArray(); }

std::vector<uint8_t> RgbValues(const colmap::Bitmap& bitmap) {
  std::vector<uint8_t> values;
  values.reserve(static_cast<size_t>(3 * bitmap.Width()) * static_cast<size_t>(bitmap.Height()));
  colmap::BitmapColor<uint8_t> color;
  for (int y = 0; y < bitmap.Height(); ++y) {
    for (int x = 0; x < bitmap.Width(); ++x) {
      LAZYLOC_CHECK(bitmap.GetPixel(x, y, &color));
      values.insert(values.end(), {color.r, color.g, color.b});
    }
  }
  return values;
}

bool ReadImage(const std::filesystem::path& path, bool as_rgb, colmap::Bitmap* bitmap) {
  if (bitmap->Read(path.string(), as_rgb)) return true;
  FIBITMAP* const pixels = FreeImage_Load(FreeImage_GetFileType(path.c_str(), 0), path.c_str());
  const FREE_IMAGE_TYPE type = pixels == nullptr ? FIT_UNKNOWN : FreeImage_GetImageType(pixels);
  if (type == FIT_RGB16 || type == FIT_RGBA16) {
    const colmap::Bitmap colours(FreeImage_ConvertTo24Bits(pixels));
    *bitmap = as_rgb ? colours : colours.CloneAsGrey();
  }
  if (pixels != nullptr) FreeImage_Unload(pixels);
  return type == FIT_RGB16 || type == FIT_RGBA16;
}

bool ReadReduced(const std::filesystem::path& path, int size, colmap::Bitmap* bitmap) {
  if (FreeImage_GetFileType(path.c_str(), 0) == FIF_JPEG) {
    FIBITMAP* const pixels = FreeImage_Load(FIF_JPEG, path.c_str(), JPEG_GREYSCALE | size << 16);
    if (pixels == nullptr) return false;
    *bitmap = colmap::Bitmap(pixels);
    if (bitmap->IsGrey()) return true;
  }
  return ReadImage(path, /*as_rgb=*/false, bitmap);
}

colmap::Bitmap AllocateBitmap(int width, int height, bool as_rgb) {
  colmap::Bitmap bitmap;
  LAZYLOC_CHECK(bitmap.Allocate(width, height, as_rgb));
  bitmap.Fill(colmap::BitmapColor<uint8_t>(0));
  return bitmap;
}

void Turn(int quarter_turns, colmap::Bitmap* bitmap) {
  FIBITMAP* const turned = FreeImage_Rotate(bitmap->Data(), 90.0 * quarter_turns);
  LAZYLOC_CHECK(turned != nullptr);
  *bitmap = colmap::Bitmap(turned);
}

std::optional<double> ExifNumber(const colmap::Bitmap& bitmap, const std::string& name) {
  for (const FREE_IMAGE_MDMODEL directory : {FIMD_EXIF_MAIN, FIMD_EXIF_EXIF}) {
    FITAG* tag = nullptr;
    if (!FreeImage_GetMetadata(directory, const_cast<FIBITMAP*>(bitmap.Data()), name.c_str(), &tag)) continue;
    const void* const value = FreeImage_GetTagValue(tag);
    if (value == nullptr || FreeImage_GetTagCount(tag) != 1) continue;
    switch (FreeImage_GetTagType(tag)) {
      case FIDT_SHORT: return *static_cast<const uint16_t*>(value);
      case FIDT_LONG: return *static_cast<const uint32_t*>(value);
      case FIDT_RATIONAL: {
        const auto* const ratio = static_cast<const uint32_t*>(value);
        if (ratio[1] > 0) return static_cast<double>(ratio[0]) / ratio[1];
        continue;
      }
      default: continue;
    }
  }
  return std::nullopt;
}

std::optional<double> ExifFocalLengthPx(const colmap::Bitmap& bitmap) {
  const std::lock_guard<std::mutex> lock(exif_mutex);
  double focal_length = 0;
  if (!bitmap.ExifFocalLength(&focal_length) || focal_length <= 0) return std::nullopt;
  return focal_length;
}

std::string ExifCameraName(const colmap::Bitmap& bitmap) {
  const std::lock_guard<std::mutex> lock(exif_mutex);
  std::string name;
  return bitmap.ExifCameraModel(&name) ? name : "";
}

}  // namespace lazyloc

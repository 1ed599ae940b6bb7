#include "colmap_lazyloc/bridge/feature_extraction.h"

#include <algorithm>

#include "colmap_lazyloc/bridge/sift.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

// Rounds the new size down like COLMAP's feature extraction, so that keypoints are the same.
void ScaleDown(int max_size, colmap::Bitmap* bitmap) {
  const int size = std::max(bitmap->Width(), bitmap->Height());
  if (size <= max_size) return;
  const double scale = static_cast<double>(max_size) / size;
  bitmap->Rescale(std::max(1, static_cast<int>(bitmap->Width() * scale)),
                  std::max(1, static_cast<int>(bitmap->Height() * scale)));
}

}  // namespace

bool SiftExtractionOptions::Check(std::string* error) const {
  OPTION_GE(max_image_size, 1);
  OPTION_GE(max_num_features, 1);
  OPTION_GE(first_octave, -1);
  OPTION_GT(peak_threshold, 0);
  OPTION_GT(edge_threshold, 0);
  return true;
}

std::optional<Photo> ReadPhoto(const std::filesystem::path& path, const SiftExtractionOptions& options) {
  colmap::Bitmap bitmap;
  if (!bitmap.Read(path.string(), /*as_rgb=*/false)) return std::nullopt;
  Photo photo;
  photo.width = static_cast<uint64_t>(bitmap.Width());
  photo.height = static_cast<uint64_t>(bitmap.Height());
  photo.exif_focal_length_px = ExifFocalLengthPx(bitmap);
  ScaleDown(options.max_image_size, &bitmap);
  colmap::FeatureKeypoints keypoints;
  if (!ExtractSift(bitmap, options, &keypoints, &photo.features.descriptors)) return photo;  // image too small
  const float scale_x = static_cast<float>(photo.width) / bitmap.Width();
  const float scale_y = static_cast<float>(photo.height) / bitmap.Height();
  for (colmap::FeatureKeypoint& keypoint : keypoints) {
    keypoint.Rescale(scale_x, scale_y);
    photo.features.keypoints.push_back(
        {keypoint.x, keypoint.y, keypoint.a11, keypoint.a12, keypoint.a21, keypoint.a22});
  }
  return photo;
}

}  // namespace lazyloc

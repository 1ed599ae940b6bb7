#include "colmap_lazyloc/queries/cameras_by_size.h"

#include <algorithm>

namespace lazyloc {
namespace {

constexpr size_t kMaxNumCameras = 1000;

}  // namespace

CamerasBySize::CamerasBySize(const Model& model, const std::map<uint32_t, double>& exif_focal_lengths_px) {
  std::map<uint32_t, int> num_images;
  for (const ModelImage& image : model.images) ++num_images[image.camera_id];
  for (const auto& [camera_id, count] : num_images) {
    const Camera& camera = model.cameras.at(camera_id);
    const auto exif = exif_focal_lengths_px.find(camera_id);
    cameras_[std::minmax({camera.width, camera.height})].push_back(
        {camera, count, "", exif == exif_focal_lengths_px.end() ? std::nullopt : std::make_optional(exif->second)});
  }
  for (auto& [size, cameras] : cameras_) {
    std::stable_sort(cameras.begin(), cameras.end(),
                     [](const DatabaseCamera& a, const DatabaseCamera& b) { return a.num_images > b.num_images; });
    if (cameras.size() > kMaxNumCameras) cameras.resize(kMaxNumCameras);
  }
}

std::vector<DatabaseCamera> CamerasBySize::OfSize(uint64_t width, uint64_t height) const {
  const auto found = cameras_.find(std::minmax({width, height}));
  return found == cameras_.end() ? std::vector<DatabaseCamera>() : found->second;
}

}  // namespace lazyloc

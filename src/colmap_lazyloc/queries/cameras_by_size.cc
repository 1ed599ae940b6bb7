#include "colmap_lazyloc/queries/cameras_by_size.h"

#include <algorithm>

namespace lazyloc {
namespace {

constexpr size_t kMaxNumCameras = 1000;

}  // namespace

CamerasBySize::CamerasBySize(const Model& model, const ExifFocalLengths& exif_focal_lengths) {
  std::map<uint32_t, int> num_images;
  for (const ModelImage& image : model.images) ++num_images[image.camera_id];
  for (const auto& [camera_id, count] : num_images) {
    const Camera& camera = model.cameras.at(camera_id);
    cameras_[std::minmax({camera.width, camera.height})].push_back(
        {camera, count, "", exif_focal_lengths.Find(camera_id)});
  }
  for (auto& [size, cameras] : cameras_) {
    std::stable_sort(cameras.begin(), cameras.end(),
                     [](const DatabaseCamera& a, const DatabaseCamera& b) { return a.num_images > b.num_images; });
    if (cameras.size() > kMaxNumCameras) cameras.resize(kMaxNumCameras);
  }
}

const std::vector<DatabaseCamera>& CamerasBySize::OfSize(uint64_t width, uint64_t height) const {
  static const std::vector<DatabaseCamera>* const kNone = new std::vector<DatabaseCamera>();
  const auto found = cameras_.find(std::minmax({width, height}));
  return found == cameras_.end() ? *kNone : found->second;
}

}  // namespace lazyloc

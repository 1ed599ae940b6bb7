#include "colmap_lazyloc/loading/database_cameras.h"

#include <algorithm>
#include <optional>
#include <system_error>
#include <utility>

namespace lazyloc {
namespace {

// Maximum number of image files that are read for a photo of a new size, because each takes as long as the photo.
constexpr size_t kMaxNumFiles = 20;

}  // namespace

DatabaseCameras::DatabaseCameras(const QuerySelection& selection, const std::filesystem::path& image_path)
    : image_path_(image_path), cameras_(selection.PosedCameras()) {
  for (const ModelImage& image : selection.DatabaseModel().images) image_names_[image.camera_id].push_back(image.name);
}

std::vector<DatabaseCamera> DatabaseCameras::OfSize(const PhotoProperties& photo) const {
  std::vector<DatabaseCamera> cameras = cameras_.OfSize(photo.width, photo.height);
  if (photo.exif_camera.empty()) return cameras;
  for (size_t i = 0; i < std::min(cameras.size(), kMaxNumFiles); ++i) {
    cameras[i].exif_camera = ExifCamera(cameras[i].camera.camera_id);
  }
  return cameras;
}

std::string DatabaseCameras::ExifCamera(uint32_t camera_id) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto [known, is_new] = exif_camera_of_id_.try_emplace(camera_id);
  if (!is_new) return known->second;
  const std::vector<std::string>& names = image_names_.at(camera_id);
  const auto found = std::find_if(names.begin(), names.end(), [this](const std::string& name) {
    std::error_code error;
    return std::filesystem::is_regular_file(image_path_ / name, error);
  });
  if (found == names.end()) return "";
  const std::optional<PhotoFile> file = PhotoFile::Read(image_path_ / *found);
  if (file) known->second = file->Properties().exif_camera;
  return known->second;
}

}  // namespace lazyloc

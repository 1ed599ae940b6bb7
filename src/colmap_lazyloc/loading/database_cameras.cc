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

DatabaseCameras::DatabaseCameras(const Model& model, const std::filesystem::path& image_path,
                                 const ExifFocalLengths& exif_focal_lengths)
    : image_path_(image_path) {
  std::map<uint32_t, Entry> entries;
  for (const ModelImage& image : model.images) entries[image.camera_id].image_names.push_back(image.name);
  for (auto& [camera_id, entry] : entries) {
    entry.camera = {model.cameras.at(camera_id), static_cast<int>(entry.image_names.size()), "",
                    exif_focal_lengths.Find(camera_id)};
    entries_.push_back(std::move(entry));
  }
  std::stable_sort(entries_.begin(), entries_.end(),
                   [](const Entry& a, const Entry& b) { return a.image_names.size() > b.image_names.size(); });
}

std::vector<DatabaseCamera> DatabaseCameras::OfSize(const PhotoProperties& photo) const {
  std::vector<DatabaseCamera> cameras;
  for (const Entry& entry : entries_) {
    if (!HasSizeOf(photo, entry.camera.camera)) continue;
    cameras.push_back(entry.camera);
    const bool has_exif = !photo.exif_camera.empty() && cameras.size() <= kMaxNumFiles;
    if (has_exif) cameras.back().exif_camera = ExifCamera(entry);
  }
  return cameras;
}

std::string DatabaseCameras::ExifCamera(const Entry& entry) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto [known, is_new] = exif_camera_of_id_.try_emplace(entry.camera.camera.camera_id);
  if (!is_new) return known->second;
  const std::vector<std::string>& names = entry.image_names;
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

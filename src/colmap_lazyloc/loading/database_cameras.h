#pragma once

#include <filesystem>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "colmap_lazyloc/queries/query_selection.h"

namespace lazyloc {

// The cameras of the posed images, of which one may have taken a photo.
class DatabaseCameras {
 public:
  // image_path: the folder of the photos. If posed images are there too, their EXIF tells the makes and models.
  // The selection must outlive this.
  DatabaseCameras(const QuerySelection& selection, const std::filesystem::path& image_path);

  // Returns the cameras that have the photo's size, as CamerasBySize does, with their makes and models if the photo's
  // are known. Thread-safe; the result depends only on the input.
  std::vector<DatabaseCamera> OfSize(const PhotoProperties& photo) const;

 private:
  std::string ExifCamera(uint32_t camera_id) const;

  const std::filesystem::path image_path_;
  const CamerasBySize& cameras_;
  std::map<uint32_t, std::vector<std::string>> image_names_;  // by camera
  mutable std::mutex mutex_;
  mutable std::map<uint32_t, std::string> exif_camera_of_id_;  // those that were read
};

}  // namespace lazyloc

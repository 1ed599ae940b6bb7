#pragma once

#include <filesystem>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "colmap_lazyloc/queries/photo_camera.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// The cameras of the posed images, of which one may have taken a photo.
class DatabaseCameras {
 public:
  // image_path: the folder of the photos. If posed images are there too, their EXIF tells the makes and models.
  DatabaseCameras(const Model& model, const std::filesystem::path& image_path,
                  const ExifFocalLengths& exif_focal_lengths);

  // Returns the cameras that have the photo's size (HasSizeOf), most used ones first; with their makes and models if
  // the photo's are known. Thread-safe; the result depends only on the input.
  std::vector<DatabaseCamera> OfSize(const PhotoProperties& photo) const;

 private:
  struct Entry {
    DatabaseCamera camera;
    std::vector<std::string> image_names;
  };

  std::string ExifCamera(const Entry& entry) const;

  const std::filesystem::path image_path_;
  std::vector<Entry> entries_;  // most used ones first
  mutable std::mutex mutex_;
  mutable std::map<uint32_t, std::string> exif_camera_of_id_;  // those that were read
};

}  // namespace lazyloc

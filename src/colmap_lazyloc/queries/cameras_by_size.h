#pragma once

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "colmap_lazyloc/queries/photo_camera.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// The cameras of posed images by their size, of which one may have taken a query. Makes and models are not known.
class CamerasBySize {
 public:
  // exif_focal_lengths_px: those that are known, by camera id.
  CamerasBySize(const Model& model, const std::map<uint32_t, double>& exif_focal_lengths_px);

  // Returns the cameras that have this size, or that with its sides exchanged, most used ones first. There
  // are at most 1,000, because a database may have a camera for each image.
  std::vector<DatabaseCamera> OfSize(uint64_t width, uint64_t height) const;

 private:
  using Size = std::pair<uint64_t, uint64_t>;  // shorter side first
  std::map<Size, std::vector<DatabaseCamera>> cameras_;
};

}  // namespace lazyloc

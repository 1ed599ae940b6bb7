#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/rig.h"
#include "colmap_lazyloc/scene/world_axes.h"

namespace lazyloc {

// Posed image of a COLMAP model. The pose has the bytes of the file, because output poses of database images must be
// bit-identical to the input: normalise a copy of the rotation before computing with it.
struct ModelImage {
  uint32_t image_id = 0;
  uint32_t camera_id = 0;
  std::string name;
  Rigid3d cam_from_world;
};

// Cameras and posed images of a COLMAP model, without its points.
struct Model {
  std::map<uint32_t, Camera> cameras;
  std::vector<ModelImage> images;  // sorted by name
  // Both are empty if the model has no rigs and frames. Otherwise each image belongs to exactly one frame; a frame may
  // also name images that are not in `images`.
  std::map<uint32_t, Rig> rigs;
  std::map<uint32_t, ModelFrame> frames;
  WorldAxes axes;
};

// Returns the image of a name, of a list sorted by name; null if there is none.
template <typename Image>
const Image* FindByName(const std::vector<Image>& images, std::string_view name) {
  const auto image = std::lower_bound(images.begin(), images.end(), name,
                                      [](const Image& a, std::string_view b) { return a.name < b; });
  return image == images.end() || image->name != name ? nullptr : &*image;
}

}  // namespace lazyloc

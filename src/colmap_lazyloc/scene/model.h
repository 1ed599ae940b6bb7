#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/rig.h"

namespace lazyloc {

// A posed image of a COLMAP model. The pose holds the file's own numbers, bit for bit: normalise the
// rotation where it is computed with, never here.
struct ModelImage {
  uint32_t image_id = 0;
  uint32_t camera_id = 0;
  std::string name;
  Rigid3d cam_from_world;
};

// What a COLMAP model says of its cameras and posed images (points are not of interest here).
struct Model {
  std::map<uint32_t, Camera> cameras;
  std::vector<ModelImage> images;  // sorted by name
  // Both empty for a model without them. Else each image is in one frame; frames may name images that are not here.
  std::map<uint32_t, Rig> rigs;
  std::map<uint32_t, ModelFrame> frames;
};

}  // namespace lazyloc

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {

struct RigCamera {
  std::string image_prefix;
  Rigid3d cam_from_rig;
};
using RigCameras = std::vector<RigCamera>;

// Reads the rigs of COLMAP's JSON for rig_configurator: a list of {"cameras": [{"image_prefix": ..., "ref_sensor": true
// or "cam_from_rig_rotation": [w, x, y, z] and "cam_from_rig_translation": [x, y, z]}, ...]}. Throws InputError naming
// the file, the rig and the camera.
std::vector<RigCameras> ReadRigConfig(const std::filesystem::path& path);

}  // namespace lazyloc

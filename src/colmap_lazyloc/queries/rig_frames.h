#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// The frame that an image belongs to, and the place of its camera in the rig.
struct FramePlace {
  std::string frame_name;
  Rigid3d cam_from_rig;
};
using FramePlaces = std::unordered_map<std::string, FramePlace>;  // by image name

// Finds the rig frames of images by the image prefixes of a rig configuration (formats/rig_config.h). Throws InputError
// naming the file if it is damaged or puts an image into two cameras.
FramePlaces FramesFromConfig(const std::vector<std::string_view>& image_names,
                             const std::filesystem::path& rig_config_path);

// Images that have no place in a rig although the database puts them into a frame.
struct FrameProblems {
  std::vector<std::string> images_without_pose;  // names; their camera has no pose in its rig
  std::vector<std::string> damages;              // as in DamagedRecordError
};

// Finds the rig frames of images in the model (COLMAP 4; frames with two or more of the images), else in the database
// (COLMAP 4.x; null if there is none). Adds what is wrong there to `problems`.
FramePlaces FramesFromColmap(const std::vector<std::string_view>& image_names, const DatabaseReader* database,
                             const Model& model, FrameProblems* problems);

// Returns the places of the images that share their frame with another image.
FramePlaces SharedFrames(const FramePlaces& places);

}  // namespace lazyloc

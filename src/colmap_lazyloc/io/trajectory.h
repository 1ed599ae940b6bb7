#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {

// cam_from_world in the trajectory's own frame, by image name. path: a folder with a COLMAP model, or a file with lines
// `name qw qx qy qz tx ty tz` (cam_from_world) or TUM's `timestamp tx ty tz qx qy qz qw` (world_from_cam; the timestamp
// is the file name of its image, less folders and extension, as a number; query_names serve to find it). Throws
// InputError naming file and line.
std::map<std::string, Rigid3d> ReadTrajectory(const std::filesystem::path& path,
                                              const std::vector<std::string>& query_names);

}  // namespace lazyloc

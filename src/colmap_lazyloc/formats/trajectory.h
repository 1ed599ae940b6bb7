#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {

// Reads cam_from_world in the trajectory's own world, by image name. path: a folder with a COLMAP model, or a file with
// lines `name qw qx qy qz tx ty tz` (cam_from_world) or TUM's `timestamp tx ty tz qx qy qz qw` (world_from_cam). A
// timestamp belongs to the query whose file name, without folders and extension, is the same number. Throws InputError
// naming file and line.
std::map<std::string, Rigid3d> ReadTrajectory(const std::filesystem::path& path,
                                              const std::vector<std::string>& query_names);

}  // namespace lazyloc

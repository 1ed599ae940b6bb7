#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "colmap_lazyloc/scene/control_point.h"

namespace lazyloc {

// Reads control points, each followed by its marks, from lines
//   point NAME x y z stddev_x stddev_y stddev_z
//   mark IMAGE x y
// and '#' comments. Names may hold blanks. is_image: returns true for the names of images that may have marks. Throws
// InputError, `file:line: ...`, for a missing or empty file, other lines and names, a point that is listed twice or has
// no mark, an image with two marks of a point, and impossible numbers.
std::vector<ControlPoint> ReadControlPoints(const std::filesystem::path& path,
                                            const std::function<bool(const std::string&)>& is_image);

}  // namespace lazyloc

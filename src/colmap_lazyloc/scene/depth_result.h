#pragma once

#include <array>
#include <string>
#include <vector>

#include "colmap_lazyloc/scene/enum_names.h"

namespace lazyloc {

// What became of the depth map of a database image.
enum class DepthVerdict {
  USED,
  NO_SCALE,      // it is not stated to be metric, and too few triangulated points tell its scale
  CONTRADICTED,  // triangulated points contradict it: their depths scatter too much around it
};
template <>
inline constexpr std::array<const char*, 3> kEnumNames<DepthVerdict> = {"used", "no_scale", "contradicted"};

struct DepthMapResult {
  std::string database_name;
  DepthVerdict verdict = DepthVerdict::NO_SCALE;
  int num_points = 0;  // triangulated points that the map was compared with
  double scale = 1;    // factor on the map's depths, and its relative standard deviation; only if used
  double scale_stddev = 0;
  double depth_stddev = 0;  // relative standard deviation of the map's depths at these points; 0 if unknown
};

// What depth maps contribute to a query.
struct DepthResult {
  std::vector<DepthMapResult> maps;  // of the database images with a map
  int num_points = 0;                // points of the pose that have a depth
  bool fixes_distance = false;       // true if the pose rests on the depths, because nothing else tells its distance
};

}  // namespace lazyloc

#pragma once

#include <optional>

#include "colmap_lazyloc/math/geodetic.h"

namespace lazyloc {

// What is known about the axes of a model.
struct WorldAxes {
  // Origin of the axes, which are then east, north and up, in metres; nullopt if the place on Earth is unknown.
  std::optional<GeodeticPoint> geographic_origin;
  // True if no axis is known to point up, as in a model of COLMAP's mapper.
  bool are_arbitrary = false;
};

}  // namespace lazyloc

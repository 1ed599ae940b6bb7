#pragma once

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

// Error of a match of two images.
struct EpipolarError {
  // Square of the distance from the epipolar lines in pixels, to first order (Sampson 1982); of the parallax if the
  // point is behind an image.
  double squared_px = 0;
  bool is_in_front = false;  // true if the point is in front of both images
};

// a_from_b: relative pose of the two images, in the axes of their cameras; its translation may have any length but
// zero.
EpipolarError MeasureEpipolarError(const Rigid3d& a_from_b, const Observation& a, const Observation& b);

}  // namespace lazyloc

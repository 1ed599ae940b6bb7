#pragma once

#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/pair_geometry.h"

namespace lazyloc {

// Returns true if most matches of a pair are near the epipolar lines of the poses: within two standard deviations of
// the noise that stages start with.
bool FitsPoses(const PosedImages& posed, const PairGeometry& pair);

}  // namespace lazyloc

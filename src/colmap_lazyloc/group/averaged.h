#pragma once

#include <optional>
#include <vector>

#include "colmap_lazyloc/group/failure.h"
#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/pair_geometry.h"
#include "colmap_lazyloc/translation/relative_direction.h"

namespace lazyloc {

// Result of motion averaging: poses, or the reason why there are none.
struct Averaged {
  PosedImages posed;                          // query frames at their averaged poses
  PairRefs pairs;                             // those that agree with the averaged rotations
  std::vector<RelativeDirection> directions;  // by pair; zero if unknown
  std::optional<Failure> failure;
};

}  // namespace lazyloc

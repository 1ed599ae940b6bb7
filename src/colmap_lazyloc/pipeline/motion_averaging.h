#pragma once

#include <optional>
#include <vector>

#include "colmap_lazyloc/pipeline/failure.h"
#include "colmap_lazyloc/pipeline/layout.h"
#include "colmap_lazyloc/scene/pair_geometry.h"
#include "colmap_lazyloc/scene/stage_timer.h"
#include "colmap_lazyloc/translation/relative_direction.h"

namespace lazyloc {

// Result of motion averaging: poses, or the reason why there are none.
struct Averaged {
  PosedImages posed;                          // query frames at their averaged poses
  PairRefs pairs;                             // those that agree with the averaged rotations
  std::vector<RelativeDirection> directions;  // by pair; zero if unknown
  std::optional<Failure> failure;
};

// Averages the rotations, then the translations of the query frames with the database poses fixed (LazyLoc,
// sections 3.1 and 3.2). Throws Failure unless a single frame may be localized without averaging, from another start;
// then the result has the failure and all pairs that are left.
Averaged AverageMotion(const Layout& layout, const std::vector<PairGeometry>& pairs, const LocalizerOptions& options,
                       StageTimer::Seconds* seconds);

}  // namespace lazyloc

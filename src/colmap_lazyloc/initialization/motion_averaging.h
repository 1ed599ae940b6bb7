#pragma once

#include <vector>

#include "colmap_lazyloc/group/averaged.h"
#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/rotation/rotation_averaging.h"
#include "colmap_lazyloc/scene/stage_timer.h"
#include "colmap_lazyloc/translation/translation_averaging.h"

namespace lazyloc {

// The methods of averaging; others than the defaults are for comparisons.
struct AveragingMethods {
  RotationAverager rotations = AverageByL1Irls;
  TranslationAverager translations = AverageByAngles;
};

// Averages the rotations, then the translations of the query frames with the database poses fixed (LazyLoc,
// sections 3.1 and 3.2). Throws Failure unless a single frame may be localized without averaging, from another start;
// then the result has the failure and all pairs that are left.
Averaged AverageMotion(const Layout& layout, const std::vector<PairGeometry>& pairs, const LocalizerOptions& options,
                       StageTimer::Seconds* seconds, const AveragingMethods& methods = {});

}  // namespace lazyloc

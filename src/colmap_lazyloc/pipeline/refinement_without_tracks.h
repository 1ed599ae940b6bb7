#pragma once

#include "colmap_lazyloc/group/averaged.h"
#include "colmap_lazyloc/group/pair_estimation.h"

namespace lazyloc {

// Refines the averaged pose of a single query by what the paper compares its post optimization with (folder ablation/).
// Throws Failure if that fails. `averaged` must have a pose.
PosedImages RefineWithoutTracks(const QueryGroup& query, const Layout& layout, const Averaged& averaged,
                                const LocalizerOptions& options);

}  // namespace lazyloc

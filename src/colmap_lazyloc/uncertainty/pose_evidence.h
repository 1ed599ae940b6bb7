#pragma once

#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/group/pair_estimation.h"
#include "colmap_lazyloc/scene/pose_distribution.h"
#include "colmap_lazyloc/scene/pose_evidence.h"
#include "colmap_lazyloc/uncertainty/refined.h"

namespace lazyloc {

// Measures the evidence of each query frame, from the stages' results; without competing poses.
std::vector<PoseEvidence> MeasureEvidence(const Layout& layout, const PairEstimates& estimates, const Refined& refined,
                                          const std::vector<PoseDistribution>& poses);

}  // namespace lazyloc

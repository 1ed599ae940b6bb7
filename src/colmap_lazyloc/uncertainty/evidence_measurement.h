#pragma once

#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/scene/pose_distribution.h"
#include "colmap_lazyloc/scene/pose_evidence.h"
#include "colmap_lazyloc/uncertainty/refined.h"

namespace lazyloc {

// Measures the evidence of each query frame, from the stages' results; without competing poses. num_inliers: of the
// pairs of each query (group/pair_estimation.h).
std::vector<PoseEvidence> MeasureEvidence(const Layout& layout, const std::vector<std::vector<int>>& num_inliers,
                                          const Refined& refined, const std::vector<PoseDistribution>& poses);

}  // namespace lazyloc

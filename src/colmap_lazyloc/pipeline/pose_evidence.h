#pragma once

#include <vector>

#include "colmap_lazyloc/pipeline/layout.h"
#include "colmap_lazyloc/pipeline/pair_estimation.h"
#include "colmap_lazyloc/pipeline/pose_uncertainty.h"
#include "colmap_lazyloc/pipeline/refinement_rounds.h"
#include "colmap_lazyloc/scene/pose_evidence.h"

namespace lazyloc {

// Returns the evidence of each query frame, from the stages' results. has_relative_poses: false if the pairs have none.
std::vector<PoseEvidence> MeasureEvidence(const Layout& layout, const PairEstimates& estimates, bool has_relative_poses,
                                          const Refined& refined, const std::vector<PoseUncertainty>& uncertainties);

}  // namespace lazyloc

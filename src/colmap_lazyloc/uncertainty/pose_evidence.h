#pragma once

#include <optional>
#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/group/pair_estimation.h"
#include "colmap_lazyloc/scene/pose_distribution.h"
#include "colmap_lazyloc/scene/pose_evidence.h"
#include "colmap_lazyloc/uncertainty/refined.h"

namespace lazyloc {

struct MeasuredEvidence {
  std::vector<PoseEvidence> evidence;  // by query frame
  // Poses by query frame that pairs agree on which disagree with the frame's pose; nullopt if there is none.
  std::vector<std::optional<Rigid3d>> competing_poses;
};

// Measures the evidence of each query frame, from the stages' results.
MeasuredEvidence MeasureEvidence(const Layout& layout, const PairEstimates& estimates, const Refined& refined,
                                 const std::vector<PoseDistribution>& poses);

}  // namespace lazyloc

#pragma once

#include <vector>

#include "colmap_lazyloc/pipeline/layout.h"
#include "colmap_lazyloc/pipeline/pair_estimation.h"
#include "colmap_lazyloc/pipeline/pose_uncertainty.h"
#include "colmap_lazyloc/pipeline/refinement_rounds.h"
#include "colmap_lazyloc/scene/pose_evidence.h"

namespace lazyloc {

// Inliers of pairs by the pose that their measured relative poses speak for.
struct PairVotes {
  double num_agreeing = 0;   // with the frame's pose
  double num_competing = 0;  // with one other pose, the one that most of the others agree on
};

// Counts the votes for a frame's pose. A competing pose is one at which the measured directions of two pairs of one
// rotation cross, and distinct from the frame's pose: by its rotation, or by a distance of a tenth of the distance to
// the scene. num_explained: by image, the number of matches that the tracks of the frame's pose hold. A pair with most
// of its matches there agrees whatever its relative pose, because a plane leaves two.
PairVotes CountVotes(const Layout& layout, const std::vector<PairGeometry>& pairs, int frame,
                     const Rigid3d& frame_from_world, double scene_distance,
                     const std::vector<int>& num_explained = {});

// Returns the evidence of each query frame, from the stages' results. has_relative_poses: false if the pairs have none.
std::vector<PoseEvidence> MeasureEvidence(const Layout& layout, const PairEstimates& estimates, bool has_relative_poses,
                                          const Refined& refined, const std::vector<PoseUncertainty>& uncertainties);

}  // namespace lazyloc

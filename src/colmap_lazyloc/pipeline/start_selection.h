#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// What a pose of a frame is judged by, i.e. of its reference view.
struct StartEvidence {
  const std::vector<View>& views;
  const std::vector<Track>& tracks_from_database;  // with points
  const std::vector<Track>& tracks_with_query;     // the others, without points
  double max_error_px = 0;
  double min_inlier_ratio = 0.1;  // an absolute pose with fewer may be missed, which saves trials
  int frame = 0;
};

// One truncated score for every hypothesis: a sum of max(0, 1 - (error / max_error_px)^2), the error being
// the reprojection error of a point that the database triangulates, in each image of the frame, or, at half the weight
// as it binds one coordinate only, the distance from the epipolar line of the one other view that a track has, a
// database one.
double ScoreStart(const StartEvidence& evidence, const Rigid3d& reference_from_world);

// Hypotheses; none where there is too little to make one of.
std::optional<Rigid3d> AbsolutePoseStart(const StartEvidence& evidence, uint32_t seed);
std::optional<Rigid3d> GeneralizedRelativePoseStart(const StartEvidence& evidence, uint32_t seed);

// Triangulates the start's tracks from the database views and chooses the frames' poses to start from: motion
// averaging's, which stands where few points are seen twice; an absolute pose (P3P, generalized for a rig), which also
// stands where database cameras and query are on one line; or, where few points are seen twice and nothing is sure, a
// generalized relative pose over all pairs. Throws QueryFailure where there is none.
void ChooseStartPose(QueryState* state);

}  // namespace lazyloc

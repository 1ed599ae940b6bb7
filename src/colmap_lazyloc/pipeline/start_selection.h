#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// Motion averaging's pose of the query (view 0) against COLMAP's absolute pose (P3P) on points that the database views
// triangulate by themselves: returns the one that brings more of the points near their image points, by the score
//   sum over the points in front of the query of max(0, 1 - (error / max_error_px)^2).
// Absolute pose fixes the position where database cameras and query stand on one line; motion averaging stands where few
// points are seen twice. tracks: with points; the first observation is the query's.
Rigid3d ChooseStart(const std::vector<View>& views, const std::vector<Track>& tracks, double max_error_px,
                    uint32_t seed);

// The score above, and COLMAP's absolute pose; none where none is found (see EstimateAbsolutePose).
double ScoreStart(const Rigid3d& cam_from_world, const std::vector<Track>& tracks, double max_error_px);
std::optional<Rigid3d> AbsolutePose(const std::vector<Track>& tracks, double max_error_px, uint32_t seed,
                                    double min_inlier_ratio = 0.1);

// Triangulates the candidate tracks from the database views and chooses the query's pose to start from.
void ChooseStartPose(QueryState* state);

}  // namespace lazyloc

#pragma once

#include <vector>

#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/stage_summary.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

struct PoseRefinementResult {
  StageSummary summary;
  PosedImages posed;
};

// Refines the pose of each query by its matches with database images, without points: the paper's alternative to
// bundle adjustment (LazyLoc, section 3.3). Each match of a track has the epipolar error e = g / s, with g = c . (a x
// b), a and b the two rays and c the baseline, in the world, and s the standard deviation of g to first order in the
// noise of both keypoints (Sampson; Hartley & Zisserman, Multiple View Geometry, section 11.4.3). Minimises 1/2 sum k^2
// log(1 + e^2 / k^2), k the loss scale, by Levenberg-Marquardt. Tracks need no points. Blind to false matches along the
// epipolar line, and to the position along a line of collinear cameras.
//
// Queries must be single images. summary.success is false, and the poses are those of the input, if a query has fewer
// than six matches or its cost is not finite.
// function_tolerance: minimum relative decrease of the cost by a step that is not the last.
PoseRefinementResult RefineBySampsonError(const PosedImages& posed, const std::vector<Track>& tracks,
                                          double function_tolerance = 1e-6);

}  // namespace lazyloc

#pragma once

#include <string>
#include <vector>

#include "colmap_lazyloc/scene/stage_summary.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

struct SampsonRefinementOptions {
  double loss_scale_sigma = 2;  // Cauchy scale, in standard deviations of the error
  int max_num_iterations = 50;
  double function_tolerance = 1e-6;  // end when a step lowers the cost by a smaller part of it

  bool Check(std::string* error) const;
};

// An ablation of bundle adjustment without points: refines the pose of each view that is not fixed by its matches in
// the fixed views. Each match of a track has the epipolar error e = g / s, with g = c . (a x b), a and b the two rays
// and c the baseline, in the world, and s the standard deviation of g to first order in both image points' noise
// (Sampson). Minimises 1/2 sum k^2 log(1 + e^2 / k^2), k the loss scale, by Levenberg-Marquardt. Tracks need no points.
// Blind to false matches along the epipolar line, and to the position along a line on which all cameras stand.
// Hartley & Zisserman, Multiple View Geometry, section 11.4.3; LazyLoc, ablation of section 3.3.
// summary.success is false, and nothing is changed, where a free view has less than six matches or its cost is not
// finite.
StageSummary RefineBySampsonError(const SampsonRefinementOptions& options, const std::vector<Track>& tracks,
                                  std::vector<View>* views);

}  // namespace lazyloc

#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/stage_summary.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

struct BundleAdjustmentOptions {
  double loss_scale_sigma = 2;  // Cauchy scale, in the views' standard deviations
  int max_num_iterations = 50;
  double function_tolerance = 1e-6;  // end when a step lowers the cost by a smaller part of it

  bool Check(std::string* error) const;
};

// Minimises 1/2 sum s^2 log(1 + |r|^2 / s^2), r the reprojection error in its view's standard deviations
// and s the loss scale, over the poses of
// the views that are not fixed and over the tracks' points, in place. Fixed views enter as constants: no variable is made
// of them, so that they cannot move. LazyLoc section 3.3.
//
// Levenberg-Marquardt with the points eliminated (Schur complement), written for this one shape of problem: thousands
// of points, each seen by many constant cameras and a few free ones. On it, it takes a small part of the time of a
// general solver, which the tests compare it with.
StageSummary AdjustBundle(const BundleAdjustmentOptions& options, std::vector<View>* views, std::vector<Track>* tracks);

}  // namespace lazyloc

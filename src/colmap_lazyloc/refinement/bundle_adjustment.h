#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/stage_summary.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

struct BundleAdjustmentOptions {
  double loss_scale_px = 1;  // Cauchy scale of the reprojection error
  int max_num_iterations = 50;
  double function_tolerance = 1e-8;

  bool Check(std::string* error) const;
};

// Minimises the robust reprojection error over the poses of the views that are not fixed and over the tracks' points, in
// place (Ceres). Fixed views enter as constants: no solver variable is made of them, so that they cannot move.
// LazyLoc section 3.3.
StageSummary AdjustBundle(const BundleAdjustmentOptions& options, std::vector<View>* views, std::vector<Track>* tracks);

}  // namespace lazyloc

#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/refinement/prior_fit.h"
#include "colmap_lazyloc/scene/stage_summary.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

struct BundleAdjustmentOptions {
  double loss_scale_sigma = 2;  // Cauchy scale, in the views' standard deviations
  int max_num_iterations = 50;
  // The step that moves the poses by less, in standard deviations (root mean square over the poses), is the last one.
  double convergence_sigma = 0.2;
  bool fits_priors = true;  // whether the result has them

  bool Check(std::string* error) const;
};

struct BundleAdjustmentResult {
  StageSummary summary;
  // Per view, of the tangent (w, dt) of cam_from_world (R <- ExpSO3(w) R, t <- t + dt; rad, database units), for image
  // noise as the views state it, all points, other poses and focal lengths being unknown too. Zero for constant views;
  // of a motion that nothing shows in the image the variance is finite, but larger than that of any that shows.
  std::vector<Eigen::Matrix<double, 6, 6>> pose_covariances;
  // Whether the database's poses deviate as their priors state, and what of the covariances hangs on that. Zero where
  // there are no priors, nobody asks for them, or more cameras are than a dense matrix solves.
  PriorFit prior_fit;
  std::vector<Eigen::Matrix<double, 6, 6>> prior_parts;
};

// Minimises, in place, over the poses of all views that are not constant and over the tracks' points
//   1/2 sum s^2 log(1 + |r|^2 / s^2) + 1/2 sum |p|^2,
// r the reprojection error in its view's standard deviations, s the loss scale, and p the deviation of a database view
// from its prior in the prior's standard deviations. Views of a rig move as one.
// Constant views enter as constants: no variable is made of them, so that they cannot move. LazyLoc section 3.3; the
// priors are ours.
//
// Levenberg-Marquardt with the points eliminated (Schur complement), written for this one shape of problem: many
// points, few cameras, most of them constant or nearly so. On it, it takes a small part of the time of a general
// solver, which the tests compare it with.
BundleAdjustmentResult AdjustBundle(const BundleAdjustmentOptions& options, std::vector<View>* views,
                                    std::vector<Track>* tracks);

}  // namespace lazyloc

#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/refinement/intrinsics_score.h"
#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/stage_summary.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

struct BundleAdjustmentOptions {
  double loss_scale_sigma = kLossScaleSigma;  // Cauchy scale in standard deviations of the images' noise
  int max_num_iterations = 50;
  // Bound on the last step, or on twice the next one, in standard deviations of the poses (root mean square).
  double convergence_sigma = 0.2;
  bool computes_covariances = true;  // true to compute them, component_covariances of prior_fits, and intrinsics_scores

  bool Check(std::string* error) const;
};

// What an adjustment says of the deviations p of a prior group's frames.
struct PriorFit {
  Eigen::Matrix<double, Eigen::Dynamic, 6> deviations;  // p, by frame of the group
  // Information of the images on p, without the priors: for image noise as stated, with all points, query poses,
  // calibrations and factors unknown too. One coordinate of all frames after the other. The frames of other prior
  // groups count as constant, because else the equations of all queries would have to be solved for each.
  Eigen::MatrixXd information;
  // Covariance of cam_from_world that unit variance of a component causes, by component and image. Zero for database
  // images.
  std::vector<std::vector<Eigen::Matrix<double, 6, 6>>> component_covariances = {};
};

struct BundleAdjustmentResult {
  StageSummary summary;
  PosedImages posed;
  std::vector<Track> tracks;
  // Covariances of the tangents (w, dt) of frame_from_world and cam_from_world (R <- ExpSO3(w) R, t <- t + dt; rad,
  // database units) for image noise as stated, with all points, other poses and factors unknown too. Zero for constant
  // frames. Unobservable directions get a large but finite variance. Empty without computes_covariances.
  std::vector<Eigen::Matrix<double, 6, 6>> frame_covariances, image_covariances;
  // What errors that matches share add to image_covariances, by image of a query (IntrinsicsScore). Empty without
  // computes_covariances.
  std::vector<Eigen::Matrix<double, 6, 6>> image_shared_errors;
  // How the frames of each prior group deviate from their priors. Empty for more frames than a dense matrix
  // solves.
  std::vector<PriorFit> prior_fits;
  // Scores by frame, zero for database frames; empty without computes_covariances.
  std::vector<IntrinsicsScore> intrinsics_scores;
};

// Minimises over the poses of all frames that are not constant, the focal lengths and rig scales that are estimated,
// and the tracks' points
//   1/2 sum s^2 log(1 + |r|^2 / s^2) + 1/2 sum Q_ab p_a^T p_b + 1/2 sum |e|^2,
// where r is the reprojection error in standard deviations of its image, s the loss scale, p the deviation of a
// database frame from its prior in the prior's standard deviations, and Q the inverse covariance of these deviations
// (the identity for frames of no prior group), e the deviation of a query from its own prior
// (query_prior_residual.h). LazyLoc section 3.3; the priors are ours. Constant frames enter as
// constants: no variable is made of them, so that they cannot move. If summary.success is false, poses and points are
// those of the input, and there are no covariances.
//
// Levenberg-Marquardt with the points eliminated (Schur complement). Own code, because for a single query (many points,
// few frames) it takes a small part of the time of a general solver; the tests compare it with Ceres
// (docs/decisions/bundle_adjustment.md).
BundleAdjustmentResult AdjustBundle(const PosedImages& posed, std::vector<Track> tracks,
                                    const BundleAdjustmentOptions& options);

}  // namespace lazyloc

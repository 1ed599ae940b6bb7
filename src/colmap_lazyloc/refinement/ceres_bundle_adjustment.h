#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/stage_summary.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

struct CeresOptions {
  double loss_scale_sigma = kLossScaleSigma;  // Cauchy scale in standard deviations of the images' noise
  int max_num_iterations = 100;
  // Relative decrease of the cost by the last step; Ceres' default. At 3,000 points it leaves about a twentieth of a
  // standard deviation of the pose.
  double function_tolerance = 1e-6;
  bool solves_sparsely = false;       // true to solve the reduced camera system with SuiteSparse
  bool computes_covariances = false;  // false to leave covariances and variances empty
};

struct CeresAdjustment {
  StageSummary summary;
  PosedImages posed;
  std::vector<Track> tracks;
  // One per image, for the tangent (w, dt) of cam_from_world. Zero for constant frames.
  std::vector<Eigen::Matrix<double, 6, 6>> image_covariances;
  std::vector<Eigen::Matrix3d> point_covariances;  // one per track
  // Variances of the logs of each image's focal length and of each frame's scale; nullopt if known.
  std::vector<std::optional<double>> focal_variances, scale_variances;
};

// Minimises the cost of AdjustBundle (bundle_adjustment.h) with Ceres: LazyLoc (arXiv 2307.09981), section 3.3, which
// the paper's method uses as it is. Shares neither solver nor derivatives with AdjustBundle, because both are Ceres',
// the derivatives automatic; the tests of AdjustBundle compare with it. Leaves out depths, calibrations and priors of
// queries. Database frames without a prior keep their bits. If summary.success is false, poses and points are those of
// the input, and there are no covariances; so it is if a point lies behind an image that observes it.
CeresAdjustment AdjustWithCeres(const PosedImages& posed, const std::vector<Track>& tracks,
                                const CeresOptions& options);

}  // namespace lazyloc

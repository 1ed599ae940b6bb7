#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

struct CeresOptions {
  double loss_scale_sigma = 2;
  int max_num_iterations = 500;
  bool solves_sparsely = false;      // true to solve the reduced camera system with SuiteSparse
  bool computes_covariances = true;  // false to leave covariances and variances empty
};

struct CeresAdjustment {
  bool success = false;
  double cost = 0;
  PosedImages posed;
  std::vector<Track> tracks;
  // One per image, for the tangent (w, dt) of cam_from_world. Zero for constant frames.
  std::vector<Eigen::Matrix<double, 6, 6>> image_covariances;
  std::vector<Eigen::Matrix3d> point_covariances;  // one per track
  // Variances of the logs of each image's focal length and of each frame's scale; nullopt if known.
  std::vector<std::optional<double>> focal_variances, scale_variances;
};

// Minimises the cost of AdjustBundle with Ceres. Tests compare with it because it shares neither solver nor derivatives
// with AdjustBundle: both are Ceres', the derivatives automatic.
CeresAdjustment AdjustWithCeres(const PosedImages& posed, const std::vector<Track>& tracks,
                                const CeresOptions& options);

}  // namespace lazyloc

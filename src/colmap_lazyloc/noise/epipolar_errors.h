#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/refinement/pose_prior.h"
#include "colmap_lazyloc/scene/epipolar_error.h"

namespace lazyloc {

// What the matches of two images say of the deviation p of the second pose from the given one, relative to the first:
// the log of their likelihood is rhs^T p - p^T information p / 2. The coordinates are those of PosePriorResidual for
// standard deviations of one pixel. The place along the baseline is unobservable.
struct EpipolarFit {
  Eigen::Matrix<double, 6, 6> information;
  Eigen::Matrix<double, 6, 1> rhs;
  FrameScale scale;     // between pixels and the pose
  double noise_px = 0;  // of the keypoints
};

// Fits the epipolar errors of the matches by a deviation of the relative pose. nullopt if they do not tell it: too few
// matches, a baseline that is too short beside the distance of the points, or errors that no deviation explains.
// matches: by the given rotations in the world's axes.
std::optional<EpipolarFit> FitEpipolarErrors(const Eigen::Vector3d& baseline_1to2,
                                             const std::vector<RayMatch>& matches);

}  // namespace lazyloc

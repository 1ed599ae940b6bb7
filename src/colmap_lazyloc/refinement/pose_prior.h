#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// How far a pose is from its prior, in the prior's standard deviations: rotation vector of R R_prior^T, then
// displacement of the projection centre. The jacobian is by the tangent (w, dt) of cam_from_world.
struct PosePriorResidual {
  Eigen::Matrix<double, 6, 1> error;
  Eigen::Matrix<double, 6, 6> jacobian;
};
PosePriorResidual EvaluatePosePrior(const PosePrior& prior, const Rigid3d& cam_from_world);

// A view's scales between pixels and pose: its focal length in pixels and the median distance of the tracks' points.
struct ViewScale {
  double focal_length_px = 0;
  double distance = 0;  // zero where no track reaches the view
};
std::vector<ViewScale> MeasureViewScales(const std::vector<View>& views, const std::vector<Track>& tracks);

// A prior whose rotation error, and whose position error, each move the image points by noise_px (standard deviation
// per coordinate, at the image's centre and the points' median distance). Without a unit of length, one value serves a
// desk and a city.
PosePrior MakePosePrior(const Rigid3d& cam_from_world, double noise_px, const ViewScale& scale);

// The noise_px by which adjusted database views deviate from their priors: expectation and maximisation's step
// (Dempster et al. 1977) on what the adjustment found, where `expected_noise_px` counts as the deviation of
// kNumExpectedViews further views. pose_covariances: of the adjustment, to be multiplied by variance_factor.
double EstimateDatabasePoseNoise(const std::vector<View>& views, const std::vector<ViewScale>& scales,
                                 const std::vector<Eigen::Matrix<double, 6, 6>>& pose_covariances,
                                 double variance_factor, double expected_noise_px);

}  // namespace lazyloc

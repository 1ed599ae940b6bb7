#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Deviation of a pose from its prior in the prior's standard deviations: rotation vector of R R_prior^T, then
// displacement of the frame's origin in the world. The jacobian is with respect to the tangent (w, dt) of
// frame_from_world.
struct PosePriorResidual {
  Eigen::Matrix<double, 6, 1> error;
  Eigen::Matrix<double, 6, 6> jacobian;
};
PosePriorResidual EvaluatePosePrior(const PosePrior& prior, const Rigid3d& frame_from_world);

// Scales between pixels and the pose of a frame: the median focal length and distance of its observations.
struct FrameScale {
  double focal_length_px = 0;
  double distance = 0;  // in database units; zero for a frame without observations
};
std::vector<FrameScale> MeasureFrameScales(const PosedImages& posed, const std::vector<Track>& tracks);

// Returns a prior whose rotation error, and whose position error, each move the keypoints by noise_px (standard
// deviation per coordinate, at the image's centre and the median distance of the points). Priors are stated in pixels
// because one value then serves a desk and a city.
PosePrior MakePosePrior(const Rigid3d& frame_from_world, double noise_px, const FrameScale& scale);

// Returns the noise_px by which adjusted database frames deviate from their priors: one step of expectation
// maximisation (Dempster et al. 1977) on the adjustment's result, in which expected_noise_px counts as the deviation of
// kNumExpectedFrames further frames. frame_covariances are those of the adjustment, to be multiplied by
// variance_factor.
double EstimateDatabasePoseNoise(const std::vector<Frame>& frames, const std::vector<FrameScale>& scales,
                                 const std::vector<Eigen::Matrix<double, 6, 6>>& frame_covariances,
                                 double variance_factor, double expected_noise_px);

}  // namespace lazyloc

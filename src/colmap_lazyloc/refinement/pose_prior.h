#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Deviation of a pose from its prior in the prior's standard deviations: rotation vector of R_prior^T R (in the world's
// axes), then displacement of the frame's origin in the world. The jacobian is with respect to the tangent (w, dt) of
// frame_from_world.
struct PosePriorResidual {
  Eigen::Matrix<double, 6, 1> error;
  Eigen::Matrix<double, 6, 6> jacobian;
};
PosePriorResidual EvaluatePosePrior(const PosePrior& prior, const Rigid3d& frame_from_world);

// Scales between pixels and the pose of a frame: the median focal length of its observations, and the harmonic mean of
// their distances, because a displacement moves a keypoint by the inverse of the distance: where a street is seen from
// near to far, the near points tell the position.
struct FrameScale {
  double focal_length_px = 0;
  double distance = 0;  // in database units; zero for a frame without observations
};
std::vector<FrameScale> MeasureFrameScales(const PosedImages& posed, const std::vector<Track>& tracks);

// Returns a prior whose rotation error, and whose position error, each move the keypoints by noise_px (standard
// deviation per coordinate, at the image's centre and the mean distance of the points). Priors are stated in pixels
// because one value then serves a desk and a city.
PosePrior MakePosePrior(const Rigid3d& frame_from_world, double noise_px, const FrameScale& scale);

}  // namespace lazyloc

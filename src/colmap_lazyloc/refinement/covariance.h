#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/refinement/robust_loss.h"
#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Returns the factor from pixels to standard deviations for the observations of a track in an image.
inline double ResidualFromPx(const Image& image, const Track& track) {
  return 1 / (track.noise_ratio * image.noise_px);
}

// Returns the a-posteriori variance factor: the weighted sum of squared normalised residuals over the degrees of
// freedom that the points and the query frames' poses leave.
double VarianceFactor(const PosedImages& posed, const std::vector<Track>& tracks, const RobustLoss& loss);

// Returns the covariance of an image's cam_from_world from that of its frame: 6x6 of the frame's tangent, or 7x7 with
// the log of the frame's scale if has_free_scale.
Eigen::Matrix<double, 6, 6> ImageCovariance(const Image& image, bool has_free_scale,
                                            const Eigen::MatrixXd& frame_covariance);

// Returns the median distance of the tracks' points from a camera.
double MedianDistance(const Rigid3d& cam_from_world, const TrackRefs& tracks);

}  // namespace lazyloc

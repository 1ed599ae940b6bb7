#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/localization_result.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Of an observation's error, from pixels to standard deviations.
inline double ResidualFromPx(const View& view, const Track& track) { return 1 / (track.noise_ratio * view.noise_px); }

// By what factor the variance that the tracks' errors show differs from what the views state: their weighted squared
// sum, in standard deviations, over the freedom that the points and the sought poses leave.
double VarianceFactor(const std::vector<View>& views, const std::vector<Track>& tracks, double weight_scale);

// Covariance of the projection centre, in the world. cam_from_world, covariance: in a frame whose origin is not far
// away.
Eigen::Matrix3d PositionCovariance(const Rigid3d& cam_from_world, const Eigen::Matrix<double, 6, 6>& covariance);

// Of a view whose pose follows that of a reference. reference_covariance: of the reference's tangent, and of the log
// factor on the translation between them where that is sought.
Eigen::Matrix<double, 6, 6> LinkedCovariance(const RigLink& link, bool seeks_scale,
                                             const Eigen::MatrixXd& reference_covariance);

PoseSpread ComputePoseSpread(const Rigid3d& cam_from_world, const Eigen::Matrix<double, 6, 6>& covariance);

// Median distance of the tracks' points from a view.
double MedianDistance(const View& view, const std::vector<Track>& tracks);

}  // namespace lazyloc

#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// By what factor the variance that the tracks' errors show differs from what the views state: their weighted squared
// sum, in standard deviations, over the freedom that the points and the pose leave.
double VarianceFactor(const std::vector<View>& views, const std::vector<Track>& tracks, double weight_scale);

// The largest standard deviation of a pose of given covariance, translation counted in units of a distance: above about
// 0.1, some motion of the camera hardly shows in the image.
double RelativePoseStddev(const Eigen::Matrix<double, 6, 6>& covariance, double distance);

// Median distance of the tracks' points from a view.
double MedianDistance(const View& view, const std::vector<Track>& tracks);

}  // namespace lazyloc

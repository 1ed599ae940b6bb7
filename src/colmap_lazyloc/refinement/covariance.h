#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// What the tracks say of one free view's pose, all points being unknown too: the 6x6 information matrix with the points
// eliminated, of the tangent (w, dt) of cam_from_world (R <- ExpSO3(w) R, t <- t + dt; rad, database units), for an
// image noise as the views state it. `weight_scale`: Cauchy scale by which observations are discounted, as in adjustment.
Eigen::Matrix<double, 6, 6> PoseInformation(const std::vector<View>& views, const std::vector<Track>& tracks, int view,
                                            double weight_scale);

// By what factor the variance that the tracks' errors show differs from what the views state: their weighted squared
// sum, in standard deviations, over the freedom that the points and the pose leave.
double VarianceFactor(const std::vector<View>& views, const std::vector<Track>& tracks, double weight_scale);

// The largest standard deviation of a pose of given information, translation counted in units of a distance: above about
// 0.1, some motion of the camera hardly shows in the image. Infinite where a motion does not show at all.
double RelativePoseStddev(const Eigen::Matrix<double, 6, 6>& information, double distance);

// Median distance of the tracks' points from a view.
double MedianDistance(const View& view, const std::vector<Track>& tracks);

}  // namespace lazyloc

#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// What the tracks say of one free view's pose, all points being unknown too: the 6x6 information matrix with the points
// eliminated, of the tangent (w, dt) of cam_from_world (R <- ExpSO3(w) R, t <- t + dt; rad, database units), for an
// image noise of one pixel. `weight_scale_px`: Cauchy scale by which observations are discounted, as in the adjustment.
Eigen::Matrix<double, 6, 6> PoseInformation(const std::vector<View>& views, const std::vector<Track>& tracks, int view,
                                            double weight_scale_px);

// Variance of the image noise (px^2, per coordinate) that the tracks' errors show: their weighted squared sum over what
// the points and the pose leave of it.
double ImageNoiseVariance(const std::vector<View>& views, const std::vector<Track>& tracks, double weight_scale_px);

}  // namespace lazyloc

#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// How far a pose is from its prior, in the prior's standard deviations: rotation vector of R R_prior^T, then displacement
// of the projection centre. The jacobian is by the tangent (w, dt) of cam_from_world.
struct PosePriorResidual {
  Eigen::Matrix<double, 6, 1> error;
  Eigen::Matrix<double, 6, 6> jacobian;
};
PosePriorResidual EvaluatePosePrior(const PosePrior& prior, const Rigid3d& cam_from_world);

// How far database poses are off, as seen in the image: pixels at the image centre by which a rotation error, and by
// which a position error moves points at the scene's distance (standard deviation per coordinate). Without a unit of
// length, so that one value holds for a desk and for a city.
struct DatabasePoseNoise {
  double rotation_px = 0.1;
  double position_px = 0.1;
};

// A view's scales between pixels and pose: its focal length in pixels and the median distance of the tracks' points.
struct ViewScale {
  double focal_length_px = 0;
  double distance = 0;  // zero where no track reaches the view
};
std::vector<ViewScale> MeasureViewScales(const std::vector<View>& views, const std::vector<Track>& tracks);

PosePrior MakePosePrior(const Rigid3d& cam_from_world, const DatabasePoseNoise& noise, const ViewScale& scale);

// The noise by which adjusted database views deviate from their priors: expectation and maximisation's step on what the
// adjustment found (Dempster et al. 1977), with `initial` as the knowledge of kNumPriorViews further views. pose_covariances: of
// the adjustment, in the unit of its standard deviations; variance_factor: that unit's variance.
DatabasePoseNoise EstimateDatabasePoseNoise(const std::vector<View>& views, const std::vector<ViewScale>& scales,
                                            const std::vector<Eigen::Matrix<double, 6, 6>>& pose_covariances,
                                            double variance_factor, const DatabasePoseNoise& initial);

}  // namespace lazyloc

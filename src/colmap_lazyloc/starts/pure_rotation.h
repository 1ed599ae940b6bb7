#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "colmap_lazyloc/group/averaged.h"
#include "colmap_lazyloc/group/pair_estimation.h"
#include "colmap_lazyloc/scene/pose_evidence.h"

namespace lazyloc {

// Rotation of a lone query without a baseline to any database image: a panorama, or a camera that turned on the spot.
struct RotationFit {
  Eigen::Quaterniond cam_from_world_rotation;
  Eigen::Matrix3d covariance;  // of its tangent, R <- exp(w) R, in rad
  PoseEvidence evidence;       // for it; that of a position is neutral
};

// Fits the rotation to the rays of all matches of the pairs that agree on it, as if their points were at infinity.
RotationFit FitRotation(const Layout& layout, const PairEstimates& estimates, const Averaged& averaged);

// Returns the covariance of cam_from_world for independent errors of the rotation and the projection centre.
Eigen::Matrix<double, 6, 6> PoseCovariance(const Rigid3d& cam_from_world, const Eigen::Matrix3d& rotation_covariance,
                                           const Eigen::Matrix3d& position_covariance);

}  // namespace lazyloc

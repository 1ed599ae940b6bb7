#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "colmap_lazyloc/group/averaged.h"
#include "colmap_lazyloc/group/pair_estimation.h"
#include "colmap_lazyloc/scene/pose_evidence.h"

namespace lazyloc {

// Rotation of a single query without a baseline to any database image: a panorama, or a camera that turned on the spot.
struct RotationFit {
  Eigen::Quaterniond cam_from_world_rotation;
  Eigen::Matrix3d covariance;  // of its tangent, R <- exp(w) R, in rad
  PoseEvidence evidence;       // of the rotation; position terms are left neutral
};

// Fits the rotation to the rays of all matches of the pairs that agree on it, as if their points were at infinity.
RotationFit FitRotation(const Layout& layout, const PairEstimates& estimates, const Averaged& averaged);

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {

// Estimates the absolute pose cam_from_world from 2D-3D correspondences with COLMAP: P3P in LO-RANSAC, EPnP on the
// inliers.
//   rays_in_cam: unit length, one per point.
//   max_error_rad: maximum angle between ray and point of an inlier.
//   min_inlier_ratio: RANSAC may miss a pose with fewer inliers, because it ends earlier.
// Returns nullopt if no pose is found. The same seed gives the same result.
std::optional<Rigid3d> EstimateAbsolutePose(const std::vector<Eigen::Vector3d>& rays_in_cam,
                                            const std::vector<Eigen::Vector3d>& points_in_world, double max_error_rad,
                                            uint32_t seed, double min_inlier_ratio);

// Estimates reference_from_world of a rig's reference camera like EstimateAbsolutePose, with COLMAP's generalized P3P
// in RANSAC. cams_from_reference: pose on the rig of the camera that observes the point, one per point.
std::optional<Rigid3d> EstimateRigAbsolutePose(const std::vector<Eigen::Vector3d>& rays_in_cam,
                                               const std::vector<Rigid3d>& cams_from_reference,
                                               const std::vector<Eigen::Vector3d>& points_in_world,
                                               double max_error_rad, uint32_t seed, double min_inlier_ratio);

}  // namespace lazyloc

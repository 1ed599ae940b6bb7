#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {

// COLMAP's absolute pose from 2D-3D correspondences: P3P in LO-RANSAC (with EPnP on the inliers). rays_in_cam: unit
// length, one per point. max_error_rad: angular error of an inlier. min_inlier_ratio: a pose with fewer inliers may be
// missed, which saves trials. None where no pose is found. The same result for the same seed.
std::optional<Rigid3d> EstimateAbsolutePose(const std::vector<Eigen::Vector3d>& rays_in_cam,
                                            const std::vector<Eigen::Vector3d>& points_in_world, double max_error_rad,
                                            uint32_t seed, double min_inlier_ratio);

// The same of a rig: the pose of its reference camera, by the generalized P3P problem in RANSAC. cams_from_reference:
// of the camera that sees the point, one per point.
std::optional<Rigid3d> EstimateRigAbsolutePose(const std::vector<Eigen::Vector3d>& rays_in_cam,
                                               const std::vector<Rigid3d>& cams_from_reference,
                                               const std::vector<Eigen::Vector3d>& points_in_world,
                                               double max_error_rad, uint32_t seed, double min_inlier_ratio);

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {

// Ray of a query keypoint and ray of its match in a database image. Rays have unit length, in coordinates of their
// camera.
struct PosedRayMatch {
  Eigen::Vector3d query_ray_in_cam;
  Eigen::Vector3d database_ray_in_cam;
  Rigid3d database_cam_from_world;
  Rigid3d query_cam_from_reference;  // pose of the camera on its rig; identity for a single query
};

// Estimates reference_from_world of the query, or of its rig's reference camera, from matches with several posed
// images. No point needs to be observed by more than one of these images. Runs COLMAP's generalized relative pose in
// RANSAC: Kneip & Li, Efficient Computation of Relative Pose for Multi-Camera Systems, CVPR 2014.
//   max_error_rad: maximum Sampson error of an inlier.
// Returns nullopt if no pose is found, for example if all images were taken from one place. The same seed gives the
// same result.
std::optional<Rigid3d> EstimateGeneralizedRelativePose(const std::vector<PosedRayMatch>& matches, double max_error_rad,
                                                       uint32_t seed);

}  // namespace lazyloc

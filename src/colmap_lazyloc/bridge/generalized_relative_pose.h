#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {

// A query's ray and the ray of its match in a database image, each of unit length in its camera's frame.
struct RayMatch {
  Eigen::Vector3d query_ray_in_cam;
  Eigen::Vector3d database_ray_in_cam;
  Rigid3d database_cam_from_world;
  Rigid3d query_cam_from_reference;  // of a rig's camera; identity for a lone query
};

// COLMAP's generalized relative pose (Kneip & Li, CVPR 2014) in RANSAC: the pose of the query, or of its rig's
// reference camera, from matches with several posed images, no point of which need be seen twice. max_error_rad:
// Sampson error of an inlier. None where no pose is found, as with all images at one place. The same result for the
// same seed.
std::optional<Rigid3d> EstimateGeneralizedRelativePose(const std::vector<RayMatch>& matches, double max_error_rad,
                                                       uint32_t seed);

}  // namespace lazyloc

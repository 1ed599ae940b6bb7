#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/match.h"
#include "colmap_lazyloc/scene/two_view_geometry.h"

namespace lazyloc {

// Estimates the relative pose from matches whose rays have any direction, as those of spherical cameras have, because
// COLMAP 3 needs points in the plane z = 1: five points in LO-RANSAC. Returns config CALIBRATED with E, inliers and
// pose; PANORAMIC if a rotation alone explains most inliers; DEGENERATE if there are fewer than kMinNumInliers.
// max_error_px: maximum epipolar error of an inlier.
TwoViewGeometry EstimateRayGeometry(const Camera& other_camera, const std::vector<Eigen::Vector2d>& other_keypoints,
                                    const Camera& query_camera, const std::vector<Eigen::Vector2d>& query_keypoints,
                                    const Matches& matches, double max_error_px, uint32_t seed);

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/match.h"
#include "colmap_lazyloc/scene/two_view_geometry.h"

namespace lazyloc {

struct TwoViewGeometryOptions {
  int min_num_inliers = 15;
  double max_error_px = 4;
  bool is_query_calibrated = true;  // false: estimates a fundamental matrix and no relative pose
};

// Estimates the two-view geometry of a pair with COLMAP. If the query is calibrated, this is an essential matrix (five
// points, LO-RANSAC), or a homography if that has nearly as many inliers, with the relative pose. Keypoints are in
// pixels. Returns config DEGENERATE if there are fewer than min_num_inliers inliers. The same seed gives the same
// result on every thread.
TwoViewGeometry EstimateTwoViewGeometry(const Camera& other_camera, const std::vector<Eigen::Vector2d>& other_keypoints,
                                        const Camera& query_camera, const std::vector<Eigen::Vector2d>& query_keypoints,
                                        const Matches& matches, const TwoViewGeometryOptions& options, uint32_t seed);

// Returns the calibrated geometry of stored matches that are the inliers of one fundamental matrix and of no
// homography: that of the stored essential matrix, which COLMAP estimates for each pair whose cameras have a prior
// focal length; without one, estimates it (five points, LO-RANSAC). Returns config UNDEFINED if less than half of the
// matches are its inliers.
TwoViewGeometry EstimateCalibratedGeometry(const Camera& other_camera,
                                           const std::vector<Eigen::Vector2d>& other_keypoints,
                                           const Camera& query_camera,
                                           const std::vector<Eigen::Vector2d>& query_keypoints,
                                           const TwoViewGeometry& stored, double max_error_px, uint32_t seed);

// Sets query_from_other of a geometry that has E (CALIBRATED) or H (PLANAR, PANORAMIC) but no pose yet, by COLMAP's
// decomposition, and replaces PLANAR_OR_PANORAMIC by one of the two. Leaves the geometry unchanged if the decomposition
// fails.
void EstimateRelativePose(const Camera& other_camera, const std::vector<Eigen::Vector2d>& other_keypoints,
                          const Camera& query_camera, const std::vector<Eigen::Vector2d>& query_keypoints,
                          TwoViewGeometry* geometry);

}  // namespace lazyloc

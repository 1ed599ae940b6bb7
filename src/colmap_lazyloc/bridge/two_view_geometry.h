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
  bool is_query_calibrated = true;  // else by a fundamental matrix, without relative pose
};

// COLMAP's robust two-view geometry of a pair: essential matrix by five points where the intrinsics are known, or
// homography where that explains as much, with the relative pose. The same result for the same seed, whatever thread it
// runs on.
TwoViewGeometry EstimateTwoViewGeometry(const Camera& other_camera,
                                        const std::vector<Eigen::Vector2d>& other_keypoints,
                                        const Camera& query_camera, const std::vector<Eigen::Vector2d>& query_keypoints,
                                        const Matches& matches, const TwoViewGeometryOptions& options, uint32_t seed);

// The same for matches that are known to agree with one fundamental matrix and no homography: by their essential matrix
// alone (five points, LO-RANSAC), in a tenth of the time. UNDEFINED where it explains less than half of them.
TwoViewGeometry EstimateCalibratedGeometry(const Camera& other_camera,
                                           const std::vector<Eigen::Vector2d>& other_keypoints,
                                           const Camera& query_camera,
                                           const std::vector<Eigen::Vector2d>& query_keypoints, const Matches& matches,
                                           double max_error_px, uint32_t seed);

// COLMAP's relative pose of a geometry that has E (CALIBRATED) or H (PLANAR, PANORAMIC) but no pose yet. Sets
// query_from_other where it can, and resolves PLANAR_OR_PANORAMIC.
void EstimateRelativePose(const Camera& other_camera, const std::vector<Eigen::Vector2d>& other_keypoints,
                          const Camera& query_camera, const std::vector<Eigen::Vector2d>& query_keypoints,
                          TwoViewGeometry* geometry);

}  // namespace lazyloc

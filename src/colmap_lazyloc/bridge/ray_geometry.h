#pragma once

#include <cstdint>

#include "colmap_lazyloc/math/ray_pose.h"
#include "colmap_lazyloc/scene/localization_problem.h"

namespace lazyloc {

// Matches and the viewing rays of their keypoints, one of each image per match.
struct MatchedRays {
  Matches matches;
  Rays other, query;
};

// Leaves out matches of keypoints without a ray.
MatchedRays RaysOfMatches(const LocalizationProblem& problem, const ImagePair& pair, const Matches& matches);

// Estimates the relative pose from matches whose rays have any direction, as those of spherical cameras have, because
// COLMAP 3 needs points in the plane z = 1: five points in LO-RANSAC. Returns config CALIBRATED with E, inliers and
// pose; PANORAMIC if a rotation alone explains most inliers; DEGENERATE if there are fewer than kMinNumInliers.
// max_error_px: maximum epipolar error of an inlier.
TwoViewGeometry EstimateRayGeometry(const LocalizationProblem& problem, const ImagePair& pair, const Matches& matches,
                                    double max_error_px, uint32_t seed);

}  // namespace lazyloc

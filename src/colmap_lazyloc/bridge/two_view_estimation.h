#pragma once

#include <cstdint>

#include "colmap_lazyloc/scene/localization_problem.h"

namespace lazyloc {

// Returns COLMAP's maximum epipolar error of an inlier, 4 pixels, in the mean of the two cameras.
double MaxErrorRad(const Camera& query_camera, const Camera& other_camera);

// Estimates the two-view geometry of a pair with COLMAP: a fundamental matrix without a relative pose if the query is
// not calibrated. Else it is an essential matrix (five points, LO-RANSAC), or a homography if that has nearly as many
// inliers, with the relative pose. Returns config DEGENERATE if there are fewer than kMinNumInliers inliers. The same
// seed gives the same result on every thread.
TwoViewGeometry EstimateTwoViewGeometry(const LocalizationProblem& problem, const ImagePair& pair,
                                        const Matches& matches, bool is_query_calibrated, uint32_t seed);

// Returns the calibrated geometry of a pair whose stored matches are the inliers of one fundamental matrix and of no
// homography: that of the stored essential matrix, which COLMAP estimates for each pair whose cameras have a prior
// focal length, if at least half of the matches are its inliers; else estimates it (five points, LO-RANSAC). Returns
// config UNDEFINED if less than half are its inliers, too.
TwoViewGeometry EstimateCalibratedGeometry(const LocalizationProblem& problem, const ImagePair& pair, uint32_t seed);

// Sets query_from_other of a geometry that has E (CALIBRATED) or H (PLANAR, PANORAMIC) but no pose yet, by COLMAP's
// decomposition, and replaces PLANAR_OR_PANORAMIC by one of the two. Leaves the geometry unchanged if the decomposition
// fails.
void EstimateRelativePose(const LocalizationProblem& problem, const ImagePair& pair, TwoViewGeometry* geometry);

}  // namespace lazyloc

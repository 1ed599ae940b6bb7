#pragma once

#include <optional>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

// Pose of the query relative to another image, with the matches that are its inliers.
struct RelativePose {
  Rigid3d query_from_other;  // its translation has unit length, or is zero for a pair without baseline
  Matches inlier_matches;
};

// Returns the relative pose of a pair, from the first of these sources that is available:
//   1. the stored relative pose,
//   2. COLMAP's decomposition of the stored E or H,
//   3. COLMAP's estimate with known intrinsics, from the stored matches, if no calibrated geometry is stored.
// Returns nullopt if the pair has too few inliers, is degenerate or is a watermark. The same seed gives the same
// result.
std::optional<RelativePose> FindRelativePose(const LocalizationProblem& problem, const ImagePair& pair, uint32_t seed);

// Returns the verified matches of a pair whose query has an unknown focal length: the stored inliers of any geometry,
// or else the inliers of a fundamental matrix that COLMAP estimates. Empty if there are too few inliers, or if the pair
// is degenerate or a watermark.
Matches FindInlierMatches(const LocalizationProblem& problem, const ImagePair& pair, uint32_t seed);

}  // namespace lazyloc

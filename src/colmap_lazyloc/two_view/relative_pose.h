#pragma once

#include <optional>
#include <string>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

struct RelativePoseOptions {
  int min_num_inliers = 15;          // a pair with fewer is not used
  double max_two_view_error_px = 4;  // of inliers, where COLMAP estimates the geometry

  bool Check(std::string* error) const;
};

// Pose of the query relative to one database image, and the matches that agree with it.
struct RelativePose {
  Rigid3d query_from_other;  // translation of unit length, or zero for a pair without baseline
  Matches inlier_matches;
};

// The pair's relative pose: the stored one, one decomposed from the stored E or H by COLMAP, or one that COLMAP
// estimates from the matches, calibrated, where nothing is stored or what is stored is uncalibrated. None where the
// pair has too few inliers, or is degenerate or a watermark. The same result for the same seed.
std::optional<RelativePose> FindRelativePose(const LocalizationProblem& problem, const ImagePair& pair,
                                             const RelativePoseOptions& options, uint32_t seed);

// The pair's verified matches where the query's focal length is not known: the stored inliers, whatever geometry they
// were verified by, or those that COLMAP finds by a fundamental matrix. Empty where they are too few or of a watermark.
Matches FindInlierMatches(const LocalizationProblem& problem, const ImagePair& pair, const RelativePoseOptions& options,
                          uint32_t seed);

}  // namespace lazyloc

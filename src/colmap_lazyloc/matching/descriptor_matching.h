#pragma once

#include <string>

#include "colmap_lazyloc/scene/features.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

// COLMAP's options and defaults of SIFT matching.
struct SiftMatchingOptions {
  double max_ratio = 0.8;     // ratio of the best to the second best distance
  double max_distance = 0.7;  // angle between descriptors in rad
  bool cross_check = true;

  bool Check(std::string* error) const;
};

// Matches the SIFT descriptors (128 columns) of two images as COLMAP does: nearest neighbours by angle, ratio test,
// cross check. Returns sorted matches. Searches exact neighbours, like COLMAP's brute-force matcher, because its
// approximate search finds others in every run. Uses one thread.
Matches MatchDescriptors(const Descriptors& query, const Descriptors& database, const SiftMatchingOptions& options);

}  // namespace lazyloc

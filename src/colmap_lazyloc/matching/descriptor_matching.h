#pragma once

#include <string>

#include "colmap_lazyloc/scene/features.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

// COLMAP's options and defaults of SIFT matching.
struct SiftMatchingOptions {
  double max_ratio = 0.8;     // of the best to the second best distance
  double max_distance = 0.7;  // angle between descriptors in rad
  bool cross_check = true;

  bool Check(std::string* error) const;
};

// COLMAP's matches of two images' SIFT descriptors: nearest neighbours by angle, ratio test, cross check. The
// neighbours are the exact ones, as those of COLMAP's brute force matcher: its approximate search gives others in every
// run. Sorted. 128 columns. Uses one thread.
Matches MatchDescriptors(const Descriptors& query, const Descriptors& database, const SiftMatchingOptions& options);

}  // namespace lazyloc

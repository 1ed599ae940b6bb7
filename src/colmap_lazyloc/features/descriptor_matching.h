#pragma once

#include "colmap_lazyloc/scene/features.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

// Matches the SIFT descriptors (128 columns) of two images as COLMAP does by default: nearest neighbours by angle,
// ratio test, cross check. Returns sorted matches. Searches exact neighbours, like COLMAP's brute-force matcher,
// because its approximate search finds others in every run. Uses one thread.
Matches MatchDescriptors(const Descriptors& query, const Descriptors& database);

}  // namespace lazyloc

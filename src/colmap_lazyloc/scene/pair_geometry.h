#pragma once

#include <vector>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/match.h"
#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

// A match with the observations of its two keypoints.
struct ObservedMatch {
  Match match;
  Observation query;
  Observation other;
};

// Verified geometry of a query and another image (a database image, or an earlier query of the group).
struct PairGeometry {
  int query = -1;            // index into PosedImages::images
  int other = -1;            // likewise
  Rigid3d query_from_other;  // translation of unit length, or zero for a pair without baseline
  int num_inliers = 0;       // verified matches, those included whose keypoints the camera models cannot unproject
  std::vector<ObservedMatch> inliers;
};

// Pairs in use, which another vector owns.
using PairRefs = std::vector<const PairGeometry*>;

}  // namespace lazyloc

#pragma once

#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/scene/pair_geometry.h"

namespace lazyloc {

// Maximum number of tracks of a query for the start and for all rounds but the last: as many as a rough pose needs.
inline constexpr int kMaxNumStartTracks = 300;

// Tracks without points.
struct CandidateTracks {
  std::vector<Track> all;        // of all queries
  std::vector<Track> for_start;  // at most kMaxNumStartTracks of these for each query
};

// Builds the tracks of the queries' keypoints over the inliers of the pairs.
CandidateTracks CollectTracks(const QueryGroup& group, const Layout& layout, const PairRefs& pairs);

}  // namespace lazyloc

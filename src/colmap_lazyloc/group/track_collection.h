#pragma once

#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/scene/pair_geometry.h"

namespace lazyloc {

// Tracks without points.
struct CandidateTracks {
  std::vector<Track> all;        // at most max_num_tracks for each query
  std::vector<Track> for_start;  // at most max_num_start_tracks of these for each query: as many as a rough pose needs
};

// Builds the tracks of the queries' keypoints over the inliers of the pairs.
CandidateTracks CollectTracks(const QueryGroup& group, const Layout& layout, const PairRefs& pairs,
                              const LocalizerOptions& options);

}  // namespace lazyloc

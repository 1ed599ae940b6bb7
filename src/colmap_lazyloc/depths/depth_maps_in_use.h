#pragma once

#include <vector>

#include "colmap_lazyloc/depths/depth_scale.h"
#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/group/track_collection.h"
#include "colmap_lazyloc/scene/pair_geometry.h"
#include "colmap_lazyloc/structure/track_triangulation.h"

namespace lazyloc {

struct DepthMapsInUse {
  std::vector<DepthResult> results;  // by query
  // Poses of each query frame, by relative poses of its pairs, whose distance the depths tell.
  std::vector<std::vector<Rigid3d>> starts;
};

// Compares the depth maps of a group with triangulated points. Gives the images whose map is used a scale, and their
// observations the map's depths. pairs: those in use.
DepthMapsInUse UseDepthMaps(const QueryGroup& group, const Layout& layout, const PairRefs& pairs,
                            const LocalizerOptions& options, CandidateTracks* candidates, SplitTracks* start_tracks,
                            PosedImages* posed);

}  // namespace lazyloc

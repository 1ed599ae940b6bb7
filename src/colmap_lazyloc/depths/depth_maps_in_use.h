#pragma once

#include <vector>

#include "colmap_lazyloc/depths/depth_scale.h"
#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/group/track_collection.h"
#include "colmap_lazyloc/scene/pair_geometry.h"
#include "colmap_lazyloc/structure/track_triangulation.h"

namespace lazyloc {

// Tracks and poses that a start is chosen from, and what depth maps add to them.
struct StartInput {
  CandidateTracks candidates;
  SplitTracks tracks;  // the candidates for the start
  PosedImages posed;
  std::vector<DepthResult> depths;  // by query; empty without depth maps
  // Poses of each query frame, by relative poses of its pairs, whose distance the depths tell.
  std::vector<std::vector<Rigid3d>> depth_starts;
};

// Compares the depth maps of a group with triangulated points. Returns the input with a scale for the images whose map
// is used, and the map's depths for their observations. pairs: those in use.
StartInput WithDepthMaps(const QueryGroup& group, const Layout& layout, const PairRefs& pairs,
                         const LocalizerOptions& options, StartInput input);

}  // namespace lazyloc

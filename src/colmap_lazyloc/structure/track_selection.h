#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Selects at most max_num_tracks of the tracks, in their order: those with most observations, taken in turn from the
// cells of a grid over the query, so that no part of the image is left out. keypoints: xy in pixels, of the query that
// has the first observation of each track.
std::vector<Track> SelectTracks(const std::vector<Track>& tracks, const std::vector<Eigen::Vector2d>& keypoints,
                                int max_num_tracks);
}  // namespace lazyloc

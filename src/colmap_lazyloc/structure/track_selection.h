#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// At most max_num_tracks of the tracks, in their order: those with most image points, taken in turn from the cells of a
// grid over the query's image, so that all parts of the image keep their say. keypoints: of the query, in pixels; each
// track's first observation is the query's.
std::vector<Track> SelectTracks(const std::vector<Track>& tracks, const std::vector<Eigen::Vector2d>& keypoints,
                                int max_num_tracks);
// The same without a copy where none is left out.
std::vector<Track> SelectTracks(std::vector<Track>&& tracks, const std::vector<Eigen::Vector2d>& keypoints,
                                int max_num_tracks);

}  // namespace lazyloc

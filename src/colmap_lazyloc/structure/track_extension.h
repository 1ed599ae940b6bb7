#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Matches between two database views.
struct DatabaseViewMatches {
  int view1 = -1, view2 = -1;
  const std::vector<std::pair<uint32_t, uint32_t>>* keypoints = nullptr;  // of view1, of view2
};

// The observation of a view's keypoint; none where its camera model has no ray there.
using ObserveKeypoint = std::function<std::optional<Observation>(int view, uint32_t keypoint)>;

// Adds to each track the image points in further database views that are matched to one of its own, at most one per
// view: where matches disagree on it, none. New image points are not followed further. Observations stay in the order
// of views.
void ExtendTracks(const std::vector<DatabaseViewMatches>& matches, const ObserveKeypoint& observe,
                  std::vector<Track>* tracks);

}  // namespace lazyloc

#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// Whether the image noise that adjustment assumes leaves a frame's pose open, or nothing but noise holds it. tracks:
// those that the frame sees.
bool IsPositionOpen(const QueryState& state, int frame, const std::vector<Track>& tracks);

// Names what leaves the position of an adjusted frame open, after keeping what is known of the pose in the results'
// partial_pose. variance_factor: on the adjustment's covariances.
QueryFailure FailWithOpenPosition(int frame, const std::vector<Track>& tracks, double variance_factor,
                                  QueryState* state);

// The same, thrown, for frames of one image of which several database images, all of one place, and no other queries
// are left, with the rotation and bearing of motion averaging: no two of them triangulate a point.
void CheckPlaces(QueryState* state);

// The same for frames that have no baseline: all photos were taken from one place, as far as matches show, and the
// rotation is all that is known.
void CheckBaselines(const std::function<bool(int frame)>& has_baseline, QueryState* state);

}  // namespace lazyloc

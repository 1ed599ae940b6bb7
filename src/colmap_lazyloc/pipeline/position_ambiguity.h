#pragma once

#include <optional>

#include <Eigen/Core>

#include "colmap_lazyloc/pipeline/query_state.h"

namespace lazyloc {

// Whether the image noise that adjustment assumes leaves the pose open, or nothing but noise holds it.
bool IsPositionOpen(const QueryState& state);

// Names what leaves the position of an adjusted query open, after keeping what is known of the pose in the result's
// partial_pose. covariance: of the adjusted pose.
QueryFailure FailWithOpenPosition(const Eigen::Matrix<double, 6, 6>& covariance, QueryState* state);

// The same where several database images, all of one place, are left, with the rotation and bearing of motion averaging: no
// two of them triangulate a point. None where they are not of one place.
std::optional<QueryFailure> FailAtOnePlace(QueryState* state);

// The same where all photos were taken from one place, as far as matches show: the rotation is all that is known.
QueryFailure FailWithoutBaseline(QueryState* state);

}  // namespace lazyloc

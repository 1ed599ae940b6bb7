#pragma once

#include <vector>

#include "colmap_lazyloc/loading/database_candidate.h"
#include "colmap_lazyloc/scene/query_prior.h"

namespace lazyloc {

// Returns the database images that may be among the 50 nearest of a photo, in their order: the photo is somewhere
// within three standard deviations of a rough position. Distances are Mahalanobis distances, so that an uncertain
// height hardly counts. Returns none if these are more than half of the images, or more than 200, because the position
// then tells too little.
DatabaseCandidates FindNearCandidates(const PositionPrior& position, const std::vector<DatabaseCandidate>& candidates);

}  // namespace lazyloc

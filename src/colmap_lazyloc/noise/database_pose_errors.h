#pragma once

#include <vector>

#include "colmap_lazyloc/group/localizer_options.h"
#include "colmap_lazyloc/scene/database_pose_noise.h"
#include "colmap_lazyloc/scene/localization_problem.h"

namespace lazyloc {

// Returns the errors that the options state, or else those of a typical database.
ExpectedPoseErrors ExpectPoseErrors(const LocalizerOptions& options);

// Returns for each query frame the errors that the matches of database images with each other show: how far they miss
// their epipolar lines beyond what their noise explains. Those by the options if these state any, and for frames whose
// pairs have no neighbours.
std::vector<ExpectedPoseErrors> MeasurePoseErrors(const QueryGroup& group, const LocalizerOptions& options);

}  // namespace lazyloc

#pragma once

#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/group/query_camera.h"
#include "colmap_lazyloc/scene/localization_problem.h"

namespace lazyloc {

// Returns true if the camera model has a focal length.
bool HasFocalLength(const Camera& camera);
// Returns true if the focal length of the query is estimated whatever the images say of the given value.
bool IsFocalLengthUnknown(const LocalizationProblem& problem, const LocalizerOptions& options);

// A focal length, as a factor on that of the camera, and a pose that fits it.
struct FocalLengthAndPose {
  double factor = 1;
  Rigid3d frame_from_world;
};

// Searches a grid of 29 focal lengths in [f/3, 3f]: an absolute pose (P3P in RANSAC) with each on tracks triangulated
// from the database, whose points do not depend on the query's focal length; keeps the highest score (ScoreStart).
// Throws Failure without any pose.
FocalLengthAndPose ChooseFocalLengthAndPose(const Layout& layout, const QueryCamera& camera,
                                            const std::vector<Track>& tracks_from_database,
                                            const LocalizerOptions& options);

}  // namespace lazyloc

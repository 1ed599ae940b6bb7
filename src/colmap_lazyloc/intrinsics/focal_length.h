#pragma once

#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/group/query_camera.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/uncertainty/refined.h"

namespace lazyloc {

// Returns true if the camera model has a focal length.
bool HasFocalLength(const Camera& camera);
// Returns true if the focal length of the query is estimated whatever the images say of the given value.
bool IsFocalLengthUnknown(const LocalizationProblem& problem, const LocalizerOptions& options);

// Returns the factor from the camera's focal length to COLMAP's guess.
double FactorToGuess(const Camera& camera);

// A focal length, as a factor on that of the camera, and a pose that fits it.
struct FocalLengthAndPose {
  double factor = 1;
  Rigid3d frame_from_world;
};

// Searches a grid of 29 focal lengths in [f/3, 3f], and if f is EXIF's, which can be wrong by any factor, also around
// COLMAP's guess: an absolute pose (P3P in RANSAC) with each on tracks triangulated from the database, whose points do
// not depend on the query's focal length; keeps the highest score (ScoreStart). Throws Failure without any pose.
FocalLengthAndPose ChooseFocalLengthAndPose(const Layout& layout, const QueryCamera& camera,
                                            const std::vector<Track>& tracks_from_database,
                                            const LocalizerOptions& options);

// Returns the estimate with the lowest cost of the points that the database alone triangulates, and sets its scatter to
// the mean square deviation of the others from it, as logs. An adjustment's own cost does not tell which estimate is
// right, because each adjustment has its own points, image noise and database poses. estimates: of one query, not
// empty.
Refined MostLikelyFocalLength(std::vector<Refined> estimates, const std::vector<Track>& tracks_from_database,
                              const LocalizerOptions& options);

}  // namespace lazyloc

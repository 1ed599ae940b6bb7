#pragma once

#include <vector>

#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/scene/localization_problem.h"

namespace lazyloc {

// Returns true if the camera model has a focal length.
bool HasFocalLength(const Camera& camera);
// Returns true if the focal length of the query is estimated whatever the images say of the given value.
bool IsFocalLengthUnknown(const LocalizationProblem& problem, const LocalizerOptions& options);

// The camera of a single query whose focal length is being estimated, and the tracks as it observes them.
class QueryCamera {
 public:
  explicit QueryCamera(const LocalizationProblem& problem) : problem_(problem), camera_(problem.query_camera) {}

  const Camera& Intrinsics() const { return camera_; }
  void ScaleFocalLength(double factor);
  // Returns the factor on the focal length of the query's camera.
  double FocalFactor() const { return focal_factor_; }
  // Returns the tracks with their query observations (the first ones) computed again by the present camera, without
  // those whose keypoint it cannot unproject.
  std::vector<Track> Observe(const std::vector<Track>& tracks) const;

 private:
  const LocalizationProblem& problem_;
  Camera camera_;
  double focal_factor_ = 1;
};

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

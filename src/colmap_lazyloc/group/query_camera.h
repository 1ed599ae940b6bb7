#pragma once

#include <vector>

#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/pair_geometry.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// The camera of a single query whose focal length is being estimated.
class QueryCamera {
 public:
  // problem: must outlive the camera.
  explicit QueryCamera(const LocalizationProblem& problem) : problem_(&problem), camera_(problem.query_camera) {}

  const Camera& Intrinsics() const { return camera_; }
  void ScaleFocalLength(double factor);
  // Returns the factor on the focal length of the query's camera.
  double FocalFactor() const { return focal_factor_; }
  // Returns the tracks with their query observations (the first ones) computed again by the present camera, without
  // those whose keypoint it cannot unproject.
  std::vector<Track> Observe(const std::vector<Track>& tracks) const;
  // Does the same for the inliers of pairs.
  std::vector<PairGeometry> Observe(std::vector<PairGeometry> pairs) const;
  // Takes the focal length that adjustment has found, and returns the adjustment as observed by it.
  BundleAdjustmentResult Take(BundleAdjustmentResult adjustment);

 private:
  const LocalizationProblem* problem_;
  Camera camera_;
  double focal_factor_ = 1;
};

}  // namespace lazyloc

#pragma once

#include <vector>

#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/scene/localization_problem.h"
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
  // Adjusts poses, points and the focal length, which the camera takes.
  BundleAdjustmentResult Adjust(PosedImages posed, std::vector<Track> tracks, BundleAdjustmentOptions options);

 private:
  // Returns the tracks with their query observations linearised at the points' projections instead of the keypoints.
  // There the derivatives of the errors are exact. Those at a keypoint lack the error itself: errors would shrink as
  // focal length and distance grow together, so that where these are hard to tell apart, both would grow.
  std::vector<Track> ObserveAtPoints(const PosedImages& posed, std::vector<Track> tracks) const;

  const LocalizationProblem* problem_;
  Camera camera_;
  double focal_factor_ = 1;
};

}  // namespace lazyloc

#pragma once

#include <vector>

#include "colmap_lazyloc/group/uncalibrated_camera.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// The camera of a single query whose focal length is being estimated; and its principal point and radial distortion,
// if nobody has calibrated it (UncalibratedCorrections) and its model has them.
class QueryCamera {
 public:
  // problem: must outlive the camera.
  explicit QueryCamera(const LocalizationProblem& problem);

  const Camera& Intrinsics() const { return camera_; }
  IntrinsicsOrigin Origin() const { return problem_->intrinsics_origin; }  // before they were estimated
  void ScaleFocalLength(double factor);
  // Returns the factor on the focal length of the query's camera.
  double FocalFactor() const { return focal_factor_; }
  // Returns the corrections of the query's camera that have been made.
  OtherCorrections Corrections() const;
  // Returns the tracks with their query observations (the first ones) computed again by the present camera, without
  // those whose keypoint it cannot unproject.
  std::vector<Track> Observe(const std::vector<Track>& tracks) const;
  // Adjusts poses, points and intrinsics, which the camera takes.
  BundleAdjustmentResult Adjust(PosedImages posed, std::vector<Track> tracks, BundleAdjustmentOptions options);

 private:
  // Makes the corrections that an adjustment suggests, and moves its pose and the focal length with them. Returns by
  // how many pixels the image's corners move.
  double Correct(BundleAdjustmentResult* adjustment);
  // Returns the tracks with their query observations linearised at the points' projections instead of the keypoints.
  // There the derivatives of the errors are exact. Those at a keypoint lack the error itself: errors would shrink as
  // focal length and distance grow together, so that where these are hard to tell apart, both would grow.
  std::vector<Track> ObserveAtPoints(const PosedImages& posed, std::vector<Track> tracks) const;

  const LocalizationProblem* problem_;
  Camera camera_;
  double focal_factor_ = 1;
};

}  // namespace lazyloc

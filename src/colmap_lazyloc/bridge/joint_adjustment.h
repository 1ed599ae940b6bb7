#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/joint_scene.h"
#include "colmap_lazyloc/scene/stage_summary.h"

namespace lazyloc {

struct JointAdjustment {
  StageSummary summary;
  // By which the covariance is larger than the inverse of the weighted normal equations.
  double variance_factor = 1;
  // One per image, for the tangent (w, dt) of cam_from_world, with the variance factor; zero for constant images, not
  // finite for images that their points do not determine. Empty unless they were wanted.
  std::vector<Eigen::Matrix<double, 6, 6>> covariances;
};

// Adjusts the poses of all images that are not constant, the cameras that are not constant (focal length and
// distortion), and the points. Minimises Cauchy's loss, with the scale of all stages, of the reprojection errors in
// standard deviations of the images' keypoints, by Ceres with a sparse Schur complement. Constant images and cameras
// keep every bit. A point behind an image must not be observed by it. If summary.success is false, the scene is that of
// the input. Uses one thread, because the sums of several differ in the last digits from run to run.
JointAdjustment AdjustJointly(bool computes_covariances, JointScene* scene);

// Returns the reprojection error in pixels; infinite for a point behind the image.
double ReprojectionErrorPx(const JointScene& scene, const JointPoint& point, const JointObservation& observation);

}  // namespace lazyloc

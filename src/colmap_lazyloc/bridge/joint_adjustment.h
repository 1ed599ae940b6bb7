#pragma once

#include <vector>

#include <Eigen/SparseCore>

#include "colmap_lazyloc/scene/joint_scene.h"
#include "colmap_lazyloc/scene/stage_summary.h"

namespace lazyloc {

struct JointAdjustmentOptions {
  int max_num_iterations = 100;
  double min_cost_change_ratio = 1e-7;  // of an iteration, below which adjustment ends
  bool computes_information = false;
  bool adjusts_only_points = false;  // poses and cameras keep every bit
};

struct JointAdjustment {
  StageSummary summary;
  // Factor on the inverse of the information that makes it a covariance: that of the M-estimator (Huber, 1964).
  double variance_factor = 1;
  // Information on the adjusted parameters, with the points eliminated, and with the priors: first six for each image
  // that is adjusted, then those of the cameras. The six are the tangent (w, dt) of a photo's cam_from_world, and the
  // deviation of a database image from its prior (refinement/pose_prior.h). Empty unless it was wanted.
  Eigen::SparseMatrix<double> information;
  std::vector<int> first_parameter;  // by image; -1: the image is not adjusted
  // Information that the adjusted parameters have in common with corrections of the constant cameras' intrinsics: six
  // columns for each camera of the scene, which are zero if the camera's covariance is.
  Eigen::SparseMatrix<double> coupling_with_cameras;
};

// Adjusts the poses of all images, the cameras that are not constant (focal length and distortion), and the points.
// Database images without a prior and constant cameras keep every bit. Minimizes
//   1/2 sum s^2 log(1 + |r|^2 / s^2) + 1/2 sum Q_ab p_a^T p_b + 1/2 sum |d|^2
// where r are the reprojection errors in standard deviations of the images' keypoints or of marks, s is the loss scale
// of all stages, p the deviations of the database images from their priors, Q the precision of these deviations, and d
// the deviations of control points from their survey in its standard deviations, by Ceres with a sparse Schur
// complement. A point behind an image must not be observed by it. If summary.success is false, the
// scene is that of the input. Uses one thread, because the sums of several differ in the last digits from run to run.
JointAdjustment AdjustJointly(const JointAdjustmentOptions& options, JointScene* scene);

// Returns the reprojection error in pixels; infinite for a point behind the image.
double ReprojectionErrorPx(const JointScene& scene, const JointPoint& point, const JointObservation& observation);

}  // namespace lazyloc

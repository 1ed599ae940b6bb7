#pragma once

#include <cmath>
#include <vector>

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {

// Computes the residual of AdjustBundle for Ceres' automatic derivatives. Parameters: angle-axis and translation of
// frame_from_world, log of the focal factor or of the frame's scale, point.
struct ReferenceCost {
  Observation observation;
  Image image;
  bool has_free_scale;
  template <typename T>
  bool operator()(const T* angle_axis, const T* translation, const T* log_factor, const T* point, T* residual) const {
    const Eigen::Matrix3d rotation = image.cam_from_frame.rotation.toRotationMatrix();
    const T scale = has_free_scale ? T(ceres::exp(*log_factor)) : T(1);
    T rotated[3];
    ceres::AngleAxisRotatePoint(angle_axis, point, rotated);
    T depth(0);
    residual[0] = residual[1] = T(0);
    for (int i = 0; i < 3; ++i) {
      T coordinate = scale * image.cam_from_frame.translation(i);
      for (int j = 0; j < 3; ++j) coordinate += rotation(i, j) * (rotated[j] + translation[j]);
      depth += observation.ray_in_cam(i) * coordinate;
      for (int row = 0; row < 2; ++row) residual[row] += observation.px_from_cam(row, i) * coordinate;
    }
    const T log_focal_factor = has_free_scale ? T(0) : *log_factor;
    for (int row = 0; row < 2; ++row) {
      residual[row] = (residual[row] / depth + log_focal_factor * observation.px_from_log_focal[row]) / image.noise_px;
    }
    return true;
  }
};

// Computes the deviation of frame_from_world from its prior.
struct ReferencePrior {
  PosePrior prior;
  template <typename T>
  bool operator()(const T* angle_axis, const T* translation, T* residual) const {
    const Eigen::Quaterniond inverse = prior.frame_from_world.rotation.conjugate();
    const T inverse_prior[4] = {T(inverse.w()), T(inverse.x()), T(inverse.y()), T(inverse.z())};
    T rotation[4], deviation[4];
    ceres::AngleAxisToQuaternion(angle_axis, rotation);
    ceres::QuaternionProduct(rotation, inverse_prior, deviation);
    ceres::QuaternionToAngleAxis(deviation, residual);
    const T inverse_angle_axis[3] = {-angle_axis[0], -angle_axis[1], -angle_axis[2]};
    T minus_centre[3];
    ceres::AngleAxisRotatePoint(inverse_angle_axis, translation, minus_centre);
    for (int i = 0; i < 3; ++i) {
      residual[i] /= prior.rotation_stddev_rad;
      residual[3 + i] = (-minus_centre[i] - CamInWorld(prior.frame_from_world)(i)) / prior.position_stddev;
    }
    return true;
  }
};

using CeresFrame = Eigen::Matrix<double, 7, 1>;  // angle-axis, translation, log factor

inline PosedImages MovedToCeresFrames(const std::vector<CeresFrame>& parameters, PosedImages posed) {
  for (size_t i = 0; i < parameters.size(); ++i) {
    Frame& frame = posed.frames[i];
    frame.frame_from_world = {ExpSO3(parameters[i].head<3>()), parameters[i].segment<3>(3)};
    if (frame.has_free_scale) frame.scale *= std::exp(parameters[i][6]);
  }
  for (Image& image : posed.images) {
    const double log_factor = parameters[image.frame][6];
    if (posed.frames[image.frame].has_free_scale) image.cam_from_frame.translation *= std::exp(log_factor);
    if (image.log_focal_factor) image.log_focal_factor = log_factor;
  }
  return posed;
}

// Returns the frames and images at the minimum of AdjustBundle's cost by Ceres.
inline PosedImages SolveWithCeres(SyntheticTracks scene, const BundleAdjustmentOptions& options) {
  std::vector<CeresFrame> parameters;
  ceres::Problem problem;
  for (const Frame& frame : scene.posed.frames) {
    parameters.emplace_back() << LogSO3(frame.frame_from_world.rotation), frame.frame_from_world.translation, 0;
  }
  for (size_t i = 0; i < parameters.size(); ++i) {
    double* pose = parameters[i].data();
    problem.AddParameterBlock(pose, 3);
    problem.AddParameterBlock(pose + 3, 3);
    problem.AddParameterBlock(pose + 6, 1);
    const Frame& frame = scene.posed.frames[i];
    if (!frame.has_free_scale) problem.SetParameterBlockConstant(pose + 6);
    if (frame.prior) {
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<ReferencePrior, 6, 3, 3>(new ReferencePrior{*frame.prior}), nullptr, pose,
          pose + 3);
    }
    if (!IsConstant(frame)) continue;
    problem.SetParameterBlockConstant(pose);
    problem.SetParameterBlockConstant(pose + 3);
  }
  for (const Image& image : scene.posed.images) {
    if (image.log_focal_factor) problem.SetParameterBlockVariable(parameters[image.frame].data() + 6);
  }
  for (Track& track : scene.tracks) {
    for (const TrackObservation& element : track.observations) {
      const Image& image = scene.posed.images[element.image];
      double* pose = parameters[image.frame].data();
      const bool has_free_scale = scene.posed.FrameOf(element.image).has_free_scale;
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<ReferenceCost, 2, 3, 3, 1, 3>(
                                   new ReferenceCost{element.observation, image, has_free_scale}),
                               new ceres::CauchyLoss(options.loss_scale_sigma), pose, pose + 3, pose + 6,
                               track.point_in_world.data());
    }
  }
  ceres::Solver::Options solver_options;
  solver_options.linear_solver_type = ceres::DENSE_SCHUR;
  solver_options.max_num_iterations = 200;
  solver_options.function_tolerance = solver_options.parameter_tolerance = solver_options.gradient_tolerance = 1e-15;
  solver_options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver_options, &problem, &summary);
  return MovedToCeresFrames(parameters, scene.posed);
}

// Returns options for which the result differs from the minimum by rounding errors only.
inline BundleAdjustmentOptions Precise() {
  BundleAdjustmentOptions options;
  options.convergence_sigma = 1e-9;
  options.max_num_iterations = 500;
  return options;
}

}  // namespace lazyloc

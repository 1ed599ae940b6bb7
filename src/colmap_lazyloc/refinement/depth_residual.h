#pragma once

#include <cmath>

#include <Eigen/Core>

#include "colmap_lazyloc/refinement/parameter_block.h"

namespace lazyloc {

// A depth that a map states for a point, as bundle adjustment iterates over it. Its error, in standard deviations, is
//   r = (log(axis . X + offset) - log_depth - log_scale) / stddev,
// where X is the point in the axes of the image's frame and log_scale the map's own, which adjustment estimates.
struct DepthObservation {
  int frame = -1;  // of the image, index into BundleProblem::frames; -1: constant, and X is the point in the world
  Eigen::Vector3d axis;
  double offset = 0;
  double log_depth = 0;
  double residual_from_log = 1;  // 1 / stddev
};

// The error of such a depth, and its derivatives.
struct DepthError {
  double error = 0;
  double by_log_scale = 0;
  Eigen::Vector3d by_point_in_world;
  Eigen::Matrix<double, 6, 1> by_frame;  // only if the frame is not constant

  // frame: null for a constant one. Returns false if the point lies behind the image.
  bool Evaluate(const DepthObservation& depth, const ParameterBlock* frame, double log_scale,
                const Eigen::Vector3d& point) {
    const Eigen::Vector3d rotated = frame == nullptr ? point : Eigen::Vector3d(frame->rotation * point);
    const Eigen::Vector3d in_frame =
        frame == nullptr ? rotated : Eigen::Vector3d(rotated + frame->frame_from_world.translation);
    const double along_axis = depth.axis.dot(in_frame) + depth.offset;
    if (!(along_axis > 0)) return false;
    error = depth.residual_from_log * (std::log(along_axis) - depth.log_depth - log_scale);
    by_log_scale = -depth.residual_from_log;
    const Eigen::Vector3d by_point = depth.residual_from_log / along_axis * depth.axis;
    by_point_in_world = by_point;
    if (frame == nullptr) return true;
    by_point_in_world = frame->rotation.transpose() * by_point;
    by_frame << rotated.cross(by_point), by_point;
    return true;
  }

  void Scale(double factor) {
    error *= factor;
    by_log_scale *= factor;
    by_point_in_world *= factor;
    by_frame *= factor;
  }
};

}  // namespace lazyloc

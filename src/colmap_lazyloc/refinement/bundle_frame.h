#pragma once

#include <optional>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {

// A frame, an image or a calibration that bundle adjustment moves: six parameters, and a seventh if any focal length or
// rig scale is estimated. Or the scale of a depth map: one parameter, the first.
struct BundleFrame {
  void MoveTo(const Rigid3d& pose) {
    frame_from_world = pose;
    rotation = pose.rotation.toRotationMatrix();
  }
  // Returns the log of the factor on the translations within the rig; nullopt if none is estimated.
  std::optional<double> LogScale() const { return factor_is_scale ? std::optional(log_factor) : std::nullopt; }

  Rigid3d frame_from_world;
  Eigen::Matrix3d rotation;  // of frame_from_world
  double log_factor = 0;     // on the focal length, on the translations within the rig, or on the depths of a map
  bool factor_is_scale = false;
  bool is_depth_map = false;
};

}  // namespace lazyloc

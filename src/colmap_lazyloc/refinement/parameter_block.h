#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {

// A block is for a pose (of a frame, an image or a calibration), whose parameters are the six of its tangent and, if it
// has a factor, the log of that; or for the log of the scale of a depth map, which is the first parameter.
enum class BlockKind { POSE, POSE_AND_FOCAL_LENGTH, POSE_AND_RIG_SCALE, DEPTH_SCALE };

// Parameters that bundle adjustment estimates. All blocks have six, or seven if any has a factor.
struct ParameterBlock {
  void MoveTo(const Rigid3d& pose) {
    frame_from_world = pose;
    rotation = pose.rotation.toRotationMatrix();
  }
  // Returns true if the factor is one on the translations within the rig.
  bool HasRigScale() const { return kind == BlockKind::POSE_AND_RIG_SCALE; }

  BlockKind kind = BlockKind::POSE;
  Rigid3d frame_from_world;
  Eigen::Matrix3d rotation;  // of frame_from_world
  double log_factor = 0;     // on the focal length, on the translations within the rig, or on the depths of a map
};

}  // namespace lazyloc

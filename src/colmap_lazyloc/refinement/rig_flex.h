#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/scene/frame.h"

namespace lazyloc {

// Deviation of an image's place in its frame from its calibration, in standard deviations of the rig's flex: rotation
// vector, then displacement of the projection centre in the frame's axes. The jacobians are with respect to the
// tangents (w, dt) of cam_from_world, of frame_from_world, and of the calibration's cam_from_frame.
struct RigFlexResidual {
  Eigen::Matrix<double, 6, 1> error;
  Eigen::Matrix<double, 6, 6> by_cam, by_frame, by_calibration;
};
RigFlexResidual EvaluateRigFlex(const Calibration& calibration, const Rigid3d& cam_from_frame,
                                const Rigid3d& cam_from_world, const Rigid3d& frame_from_world);

}  // namespace lazyloc

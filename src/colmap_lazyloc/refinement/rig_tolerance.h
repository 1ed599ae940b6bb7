#pragma once

#include <optional>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/frame.h"

namespace lazyloc {

// Deviation of an image's place in its frame from its calibration, in standard deviations of the rig's flex: rotation
// vector, then displacement of the projection centre in the frame's axes. The jacobians are with respect to the
// tangents (w, dt) of cam_from_world, of frame_from_world, and of the calibration's cam_from_frame. The seventh column
// is for the log of a factor: by_frame has that of the frame's scale if it is estimated, the others are zero.
struct RigToleranceResidual {
  Eigen::Matrix<double, 6, 1> error;
  Eigen::Matrix<double, 6, 7> by_cam = Eigen::Matrix<double, 6, 7>::Zero(), by_frame = by_cam, by_calibration = by_cam;
};
// log_scale: of the factor on the translation of cam_from_frame; nullopt if none is estimated.
RigToleranceResidual EvaluateRigTolerance(const Calibration& calibration, const Rigid3d& cam_from_frame,
                                          std::optional<double> log_scale, const Rigid3d& cam_from_world,
                                          const Rigid3d& frame_from_world);

}  // namespace lazyloc

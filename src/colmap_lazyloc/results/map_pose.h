#pragma once

#include <optional>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/localization_result.h"
#include "colmap_lazyloc/scene/world_axes.h"

namespace lazyloc {

struct CameraAngle {
  std::optional<double> deg;         // nullopt if no axis of the world is known to point up
  std::optional<double> stddev_deg;  // at most that of an unknown direction, 104; nullopt if the covariance is unknown
};

// Directions of a camera over level ground. Heading, pitch and roll are the angles that `lazyloc import` reads as yaw,
// pitch, roll (python/colmap_lazyloc/pose_formats/angles.py): with x east, y north and z up,
//
//   world_from_cam = Rz(-heading) Rx(pitch) Ry(roll) * (the axes of a level camera that looks north).
//
// A camera that looks straight up or down has no heading, and its roll is not apart from it: their deviations grow to
// that of an unknown direction. The direction of the photo's top is then the certain one.
struct CameraAngles {
  CameraAngle heading;      // of the optical axis, clockwise from north, in [0, 360)
  CameraAngle pitch;        // of the optical axis above the horizon, in [-90, 90]
  CameraAngle roll;         // about the optical axis, positive if the right side is lower, in (-180, 180]
  CameraAngle top_heading;  // of the photo's top (-y of the camera), clockwise from north, in [0, 360)
};

// Calls visit(name, angle) for each angle.
template <typename Visit>
void ForEachAngle(const CameraAngles& angles, const Visit& visit) {
  visit("heading", angles.heading);
  visit("pitch", angles.pitch);
  visit("roll", angles.roll);
  visit("top_heading", angles.top_heading);
}

// A pose as maps and filters have it.
struct MapPose {
  Rigid3d world_from_cam;
  // PoseDistribution::CovarianceInWorld; nullopt if unknown.
  std::optional<Eigen::Matrix<double, 6, 6>> covariance;
  CameraAngles angles;
};

// Returns the pose of a query that has one. With a geographic origin, north and up of the angles are those at the
// camera's place; otherwise they are the world's y and z. Arbitrary axes give no angles.
MapPose MakeMapPose(const LocalizationResult& result, const WorldAxes& axes);

}  // namespace lazyloc

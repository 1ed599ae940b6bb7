#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace lazyloc {

// Rigid transform target_from_source: x_target = rotation * x_source + translation. Compose transforms so that inner
// names meet: c_from_a = c_from_b * b_from_a.
struct Rigid3d {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
};

inline Eigen::Vector3d operator*(const Rigid3d& b_from_a, const Eigen::Vector3d& x_in_a) {
  return b_from_a.rotation * x_in_a + b_from_a.translation;
}

inline Rigid3d operator*(const Rigid3d& c_from_b, const Rigid3d& b_from_a) {
  return {(c_from_b.rotation * b_from_a.rotation).normalized(), c_from_b * b_from_a.translation};
}

inline Rigid3d Inverse(const Rigid3d& b_from_a) {
  const Eigen::Quaterniond rotation = b_from_a.rotation.conjugate();
  return {rotation, rotation * -b_from_a.translation};
}

// Returns the projection centre of a camera in the world frame.
inline Eigen::Vector3d CamInWorld(const Rigid3d& cam_from_world) {
  return cam_from_world.rotation.conjugate() * -cam_from_world.translation;
}

// Returns the pose of a camera from its rotation and its projection centre.
inline Rigid3d CamFromWorld(const Eigen::Quaterniond& cam_from_world_rotation, const Eigen::Vector3d& cam_in_world) {
  return {cam_from_world_rotation, cam_from_world_rotation * -cam_in_world};
}

}  // namespace lazyloc

#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {

// Returns the covariance of the projection centre in the world. The covariance of cam_from_world is that of its tangent
// (rotation, then translation); coordinates should be near the origin, because the translation's part grows with it.
inline Eigen::Matrix3d PositionCovariance(const Rigid3d& cam_from_world,
                                          const Eigen::Matrix<double, 6, 6>& covariance) {
  // C = -R^T t, R <- exp(w) R: dC = -R^T (Hat(t) w + dt).
  Eigen::Matrix<double, 3, 6> jacobian;
  jacobian << Hat(cam_from_world.translation), Eigen::Matrix3d::Identity();
  jacobian = -cam_from_world.rotation.conjugate().toRotationMatrix() * jacobian.eval();
  return jacobian * covariance * jacobian.transpose();
}

}  // namespace lazyloc

#pragma once

#include <optional>

#include <Eigen/Core>

#include "colmap_lazyloc/math/cholesky3.h"

namespace lazyloc {

// The point with the least sum of squared distances from viewing rays: COLMAP's linear multi-view triangulation
// (TriangulateMultiViewPoint) with the point's homogeneous coordinate fixed at 1 instead of all four to unit length. So
// it hangs on neither origin nor unit of the world, and needs no eigenvalue problem, of which a query would have
// thousands.
class RayIntersection {
 public:
  // direction_in_world: of unit length; its sign does not matter.
  void Add(const Eigen::Vector3d& cam_in_world, const Eigen::Vector3d& direction_in_world) {
    hessian_ += Eigen::Matrix3d::Identity() - direction_in_world * direction_in_world.transpose();
    rhs_ += cam_in_world - direction_in_world * direction_in_world.dot(cam_in_world);
  }

  // None where the rays are parallel (to about 1e-6 rad).
  std::optional<Eigen::Vector3d> Point() const {
    constexpr double kMaxInverseFactor = 1e6;
    const Eigen::Matrix3d inverse_factor = InverseCholeskyFactor(hessian_);
    if (!(inverse_factor.diagonal().array() < kMaxInverseFactor).all()) return std::nullopt;
    return inverse_factor.transpose().lazyProduct(inverse_factor.lazyProduct(rhs_));
  }

 private:
  Eigen::Matrix3d hessian_ = Eigen::Matrix3d::Zero();
  Eigen::Vector3d rhs_ = Eigen::Vector3d::Zero();
};

}  // namespace lazyloc

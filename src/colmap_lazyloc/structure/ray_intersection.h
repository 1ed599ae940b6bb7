#pragma once

#include <optional>

#include <Eigen/Core>

#include "colmap_lazyloc/math/cholesky3.h"

namespace lazyloc {

// Finds the point with the least sum of squared distances from viewing rays: COLMAP's linear multi-view triangulation
// (TriangulateMultiViewPoint) with the point's homogeneous coordinate fixed at 1 instead of all four at unit length.
// The result therefore does not depend on the origin or unit of the world, and a 3x3 system takes the place of an
// eigenvalue problem, of which a query would have thousands.
class RayIntersection {
 public:
  // Adds a ray. direction_in_world: unit length; its sign does not matter.
  void Add(const Eigen::Vector3d& cam_in_world, const Eigen::Vector3d& direction_in_world) {
    hessian_ += Eigen::Matrix3d::Identity() - direction_in_world * direction_in_world.transpose();
    rhs_ += cam_in_world - direction_in_world * direction_in_world.dot(cam_in_world);
  }

  // Returns nullopt if the rays are parallel (to about 1e-6 rad).
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

#include "colmap_lazyloc/math/mean_rotation.h"

#include <Eigen/Eigenvalues>

namespace lazyloc {

Eigen::Quaterniond MeanRotation(const std::vector<WeightedRotation>& rotations) {
  Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
  for (const auto& [rotation, weight] : rotations) sum += weight * rotation.coeffs() * rotation.coeffs().transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> eigen(sum);
  return Eigen::Quaterniond(Eigen::Vector4d(eigen.eigenvectors().col(3)));
}

}  // namespace lazyloc

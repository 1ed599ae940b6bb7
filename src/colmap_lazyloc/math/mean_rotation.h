#pragma once

#include <vector>

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>

namespace lazyloc {

struct WeightedRotation {
  Eigen::Quaterniond rotation;
  double weight = 1;
};

// Returns the rotation R with the least weighted sum of squared chords |R - R_i|_F^2: the eigenvector of sum w q q^T
// with the largest eigenvalue. The signs of the quaternions do not matter, because q and -q give the same q q^T. Not
// robust to outliers. Markley et al., Averaging Quaternions, JGCD 30(4), 2007.
inline Eigen::Quaterniond MeanRotation(const std::vector<WeightedRotation>& rotations) {
  Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
  for (const auto& [rotation, weight] : rotations) sum += weight * rotation.coeffs() * rotation.coeffs().transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> eigen(sum);
  return Eigen::Quaterniond(Eigen::Vector4d(eigen.eigenvectors().col(3)));
}

}  // namespace lazyloc

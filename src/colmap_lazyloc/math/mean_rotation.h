#pragma once

#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace lazyloc {

struct WeightedRotation {
  Eigen::Quaterniond rotation;
  double weight = 1;
};

// Returns the rotation R with the least weighted sum of squared chords |R - R_i|_F^2: the eigenvector of sum w q q^T
// with the largest eigenvalue. The signs of the quaternions do not matter, because q and -q give the same q q^T. Not
// robust to outliers. Markley et al., Averaging Quaternions, JGCD 30(4), 2007.
Eigen::Quaterniond MeanRotation(const std::vector<WeightedRotation>& rotations);

}  // namespace lazyloc

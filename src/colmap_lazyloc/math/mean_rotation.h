#pragma once

#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace lazyloc {

struct WeightedRotation {
  Eigen::Quaterniond rotation;
  double weight = 1;
};

// The rotation with the least weighted sum of squared chords |R - R_i|_F^2: the largest eigenvector of sum w q q^T, for
// which q and -q are the same. Not robust. Markley et al., Averaging Quaternions, JGCD 30(4), 2007.
Eigen::Quaterniond MeanRotation(const std::vector<WeightedRotation>& rotations);

}  // namespace lazyloc

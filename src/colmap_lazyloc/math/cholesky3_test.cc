#include "colmap_lazyloc/math/cholesky3.h"

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

TEST(InverseCholeskyFactor, TurnsTheMatrixIntoTheIdentity) {
  for (const double depth_stddev : {1.0, 1e3, 1e6}) {
    Eigen::Matrix3d root;
    root << 2, 0.3, -0.5, 0.1, 1.5, 0.7, 0.4 / depth_stddev, -0.2 / depth_stddev, 1 / depth_stddev;
    const Eigen::Matrix3d a = root.transpose() * root;
    const Eigen::Matrix3d inverse = InverseCholeskyFactor(a);
    EXPECT_TRUE(inverse.isLowerTriangular());
    EXPECT_LE((inverse * a * inverse.transpose() - Eigen::Matrix3d::Identity()).norm(),
              1e-15 * depth_stddev * depth_stddev * 10);
  }
}

TEST(InverseCholeskyFactor, IsNotFiniteWhereTheMatrixIsNotPositiveDefinite) {
  EXPECT_FALSE(InverseCholeskyFactor(Eigen::Vector3d(1, -1, 1).asDiagonal()).allFinite());
  EXPECT_FALSE(InverseCholeskyFactor(Eigen::Matrix3d::Zero()).allFinite());
}

}  // namespace
}  // namespace lazyloc

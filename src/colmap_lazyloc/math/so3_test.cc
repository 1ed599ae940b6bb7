#include "colmap_lazyloc/math/so3.h"

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

TEST(SO3, LogInvertsExpFromTinyToHalfTurn) {
  for (const double angle : {0.0, 1e-15, 1e-9, 1e-7, 1e-3, 1.0, 3.0, 3.14159}) {
    const Eigen::Vector3d w = angle * Eigen::Vector3d(1, -2, 0.5).normalized();
    EXPECT_LE((LogSO3(ExpSO3(w)) - w).norm(), 1e-14 + 1e-10 * angle) << angle;
  }
}

TEST(SO3, LogIgnoresQuaternionSign) {
  const Eigen::Quaterniond q = ExpSO3({0.3, 0.2, -0.1});
  EXPECT_LE((LogSO3(q) - LogSO3(Eigen::Quaterniond(-q.coeffs()))).norm(), 1e-15);
}

TEST(SO3, ExpRotatesByHatToFirstOrder) {
  const Eigen::Vector3d w(1e-6, -2e-6, 3e-6), x(1, 2, 3);
  EXPECT_LE((ExpSO3(w) * x - x - Hat(w) * x).norm(), 1e-10);
}

TEST(SO3, AngleBetweenIsAccurateWhereAcosIsNot) {
  EXPECT_NEAR(AngleBetweenRad({1, 0, 0}, {5, 5e-9, 0}), 1e-9, 1e-18);
  EXPECT_NEAR(AngleBetweenRad({1, 0, 0}, {-2, 0, 0}), DegToRad(180), 1e-15);
}

TEST(SO3, TangentBasisIsOrthonormal) {
  for (const Eigen::Vector3d& direction : {Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(1, -2, 3).normalized()}) {
    Eigen::Matrix3d frame;
    frame << direction, TangentBasis(direction);
    EXPECT_LE((frame.transpose() * frame - Eigen::Matrix3d::Identity()).norm(), 1e-15);
  }
}

}  // namespace
}  // namespace lazyloc

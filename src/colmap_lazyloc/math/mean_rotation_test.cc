#include "colmap_lazyloc/math/mean_rotation.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

const Eigen::Quaterniond kBase = ExpSO3({0.3, -1, 0.5});

TEST(MeanRotation, LiesHalfwayAndIgnoresQuaternionSign) {
  const Eigen::Vector3d w(0.2, 0.1, -0.3);
  const Eigen::Quaterniond negated(-(ExpSO3(-w) * kBase).coeffs());
  EXPECT_LE(AngularDistanceRad(MeanRotation({{ExpSO3(w) * kBase, 1}, {negated, 1}}), kBase), 1e-14);
}

// Rotations about one axis have a mean angle a with sum w sin(a - a_i) = 0.
TEST(MeanRotation, WeighsAnglesAboutOneAxis) {
  const Eigen::Vector3d axis = Eigen::Vector3d(1, 2, -1).normalized();
  const Eigen::Quaterniond mean = MeanRotation({{ExpSO3(0.0 * axis), 1}, {ExpSO3(1.0 * axis), 3}});
  const double angle = LogSO3(mean).dot(axis);
  EXPECT_NEAR(std::sin(angle) + 3 * std::sin(angle - 1.0), 0, 1e-14);
  EXPECT_GT(angle, 0.5);
}

}  // namespace
}  // namespace lazyloc

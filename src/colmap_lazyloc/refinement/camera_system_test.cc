#include "colmap_lazyloc/refinement/camera_system.h"

#include <random>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

// Makes systems of cameras in a chain, each of which shares points with the two before it: few (dense) and many
// (sparse).
class CameraSystems : public testing::TestWithParam<int> {};

TEST_P(CameraSystems, EqualTheDenseSolution) {
  const int num_cameras = GetParam();
  CameraSystem<6> system(num_cameras);
  for (int a = 2; a < num_cameras; ++a) system.AddPoint({a - 2, a - 1, a});
  system.AddPoint({0, 0, num_cameras - 1});  // two images of one camera
  system.Finish();

  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  CameraSystem<6>::Blocks blocks;
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(6 * num_cameras, 6 * num_cameras);
  system.SetZero(&blocks);
  const auto add = [&](int a, int b, const CameraSystem<6>::Matrix& block) {
    system.Block(a, b, &blocks) += block;
    dense.block<6, 6>(6 * a, 6 * b) += block;
    if (a != b) dense.block<6, 6>(6 * b, 6 * a) += block.transpose();
  };
  const auto random_block = [&] {
    return CameraSystem<6>::Matrix::NullaryExpr([&] { return uniform(random); }).eval();
  };
  for (int a = 0; a < num_cameras; ++a) {
    add(a, a, 40 * CameraSystem<6>::Matrix::Identity());
    for (int b = std::max(0, a - 2); b < a; ++b) add(a, b, random_block());
  }
  add(num_cameras - 1, 0, random_block());

  ASSERT_TRUE(system.Factorize(blocks));
  const Eigen::VectorXd rhs = Eigen::VectorXd::LinSpaced(6 * num_cameras, -1, 1);
  EXPECT_TRUE((dense * system.Solve(rhs)).isApprox(rhs, 1e-12));
  const Eigen::MatrixXd inverse = dense.llt().solve(Eigen::MatrixXd::Identity(dense.rows(), dense.cols()));
  const std::vector<CameraSystem<6>::Matrix> diagonal = system.DiagonalOfInverse();
  ASSERT_EQ(static_cast<int>(diagonal.size()), num_cameras);
  for (int a = 0; a < num_cameras; ++a) {
    EXPECT_TRUE(diagonal[a].isApprox(inverse.block<6, 6>(6 * a, 6 * a), 1e-9)) << a;
  }
  EXPECT_TRUE(system.ColumnsOfInverse(1).isApprox(inverse.middleCols<6>(6), 1e-9));
  const Eigen::MatrixXd some = system.EquationsOf({2, 0, 1}, blocks);
  EXPECT_EQ((some.block<6, 6>(6, 0)), (dense.block<6, 6>(0, 12))) << "of frames 0 and 2";
  EXPECT_EQ((some.block<6, 6>(12, 6)), (dense.block<6, 6>(6, 0)));
  dense.setZero();
  system.SetZero(&blocks);
  add(0, 0, -CameraSystem<6>::Matrix::Identity());
  EXPECT_FALSE(system.Factorize(blocks)) << "not positive definite";
}

INSTANTIATE_TEST_SUITE_P(FewAndMany, CameraSystems, testing::Values(3, 20, 200));

}  // namespace
}  // namespace lazyloc

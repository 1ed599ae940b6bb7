#include "colmap_lazyloc/math/selected_inverse.h"

#include <random>

#include <Eigen/LU>
#include <gtest/gtest.h>

namespace lazyloc {
namespace {

TEST(SelectedInverse, EqualsTheDenseInverseWhereTheFactorHasElements) {
  constexpr int kNumSizes = 5;
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int i = 0; i < kNumSizes; ++i) {
    const int size = 1 + 12 * i;
    Eigen::MatrixXd dense = 8 * Eigen::MatrixXd::Identity(size, size);
    for (int j = 0; j < 2 * size; ++j) {
      const int row = static_cast<int>(random() % size), col = static_cast<int>(random() % size);
      dense(row, col) = dense(col, row) = dense(row, col) + uniform(random);
    }
    const Eigen::SimplicialLLT<Eigen::SparseMatrix<double>> factor(dense.sparseView());
    ASSERT_EQ(factor.info(), Eigen::Success);
    const Eigen::SparseMatrix<double> selected = SelectedInverse(factor.matrixL());
    const Eigen::PermutationMatrix<Eigen::Dynamic> permutation(factor.permutationP());
    const Eigen::MatrixXd inverse = permutation * dense.inverse() * permutation.transpose();
    EXPECT_GE(selected.nonZeros(), size);
    for (int col = 0; col < size; ++col) {
      for (Eigen::SparseMatrix<double>::InnerIterator it(selected, col); it; ++it) {
        EXPECT_NEAR(it.value(), inverse(it.row(), col), 1e-12);
      }
    }
  }
}

}  // namespace
}  // namespace lazyloc

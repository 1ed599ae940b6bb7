#include "colmap_lazyloc/refinement/sparse_precision.h"

#include <cmath>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

namespace lazyloc {
namespace {

// Errors in a grid that drift, and have an independent part.
Eigen::MatrixXd MakeCovariance(int num_rows, int num_columns) {
  const int size = num_rows * num_columns;
  const auto variance = [&](double row, double column) { return std::pow(std::hypot(row, column), 1.5); };
  Eigen::MatrixXd covariance(size, size);
  for (int i = 0; i < size; ++i) {
    for (int j = 0; j < size; ++j) {
      const int row1 = i / num_columns, column1 = i % num_columns, row2 = j / num_columns, column2 = j % num_columns;
      covariance(i, j) =
          (variance(row1 + 1, column1) + variance(row2 + 1, column2) - variance(row1 - row2, column1 - column2)) / 2 +
          (i == j ? 0.5 : 0);
    }
  }
  return covariance;
}

double LogDeterminant(const Eigen::MatrixXd& matrix) {
  return 2 * matrix.llt().matrixLLT().diagonal().array().log().sum();
}

TEST(SparseRootOfPrecision, FewErrorsAreExact) {
  const Eigen::MatrixXd covariance = MakeCovariance(3, 7);
  const Eigen::MatrixXd root = SparseRootOfPrecision(covariance);
  EXPECT_TRUE((root.transpose() * root * covariance).isIdentity(1e-9));
}

TEST(SparseRootOfPrecision, ManyErrorsAreSparseAndNearlyExact) {
  const Eigen::MatrixXd covariance = MakeCovariance(20, 20);
  const Eigen::SparseMatrix<double, Eigen::RowMajor> root = SparseRootOfPrecision(covariance);
  EXPECT_LE(root.nonZeros(), 21 * 400);
  const Eigen::MatrixXd precision = root.transpose() * root;
  const double divergence =
      ((precision * covariance).trace() - 400 - LogDeterminant(precision) - LogDeterminant(covariance)) / 2;
  EXPECT_GE(divergence, 0);
  EXPECT_LT(divergence, 3);
}

TEST(SparseRootOfPrecision, EqualErrorsCountOnce) {
  Eigen::Matrix4d covariance;
  covariance << 1, 1, 0.5, 0.3, 1, 1, 0.5, 0.3, 0.5, 0.5, 1, 0.6, 0.3, 0.3, 0.6, 1;
  const Eigen::MatrixXd root = SparseRootOfPrecision(covariance);
  EXPECT_TRUE(root.allFinite());
  EXPECT_NEAR(1 / std::pow(root(3, 3), 2), 0.64, 1e-9);  // the variance of the last error, given the others
}

}  // namespace
}  // namespace lazyloc

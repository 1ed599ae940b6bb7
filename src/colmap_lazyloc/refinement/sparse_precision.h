#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>

namespace lazyloc {

// Returns a sparse root R of the precision R^T R of errors with this covariance, by Vecchia's approximation (1988):
// each error depends only on those before it with which it differs least. The covariance must be positive definite.
Eigen::SparseMatrix<double, Eigen::RowMajor> SparseRootOfPrecision(const Eigen::MatrixXd& covariance);

}  // namespace lazyloc

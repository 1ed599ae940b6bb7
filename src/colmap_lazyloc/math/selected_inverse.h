#pragma once

#include <Eigen/Sparse>

namespace lazyloc {

// Returns the elements of the inverse of A = L L^T that are non-zero in L. lower: L (n x n), lower triangular. The
// result has the sparsity of L; its elements are those of the lower triangle of A^-1. Takes about as long as the
// factorization. Takahashi, Fagan & Chen, Formation of a sparse bus impedance matrix and its application to short
// circuit study, 1973.
Eigen::SparseMatrix<double> SelectedInverse(Eigen::SparseMatrix<double> lower);

}  // namespace lazyloc

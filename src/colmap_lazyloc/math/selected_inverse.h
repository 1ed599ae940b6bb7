#pragma once

#include <Eigen/Sparse>

namespace lazyloc {

// Of the inverse of A = L L^T (L lower triangular), the elements of the lower triangle where L has some, in the place
// of L's: Takahashi, Fagan & Chen, Formation of a sparse bus impedance matrix, 1973. It takes about as long as the
// factorization.
Eigen::SparseMatrix<double> SelectedInverse(Eigen::SparseMatrix<double> lower);

}  // namespace lazyloc

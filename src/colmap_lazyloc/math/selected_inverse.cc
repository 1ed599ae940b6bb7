#include "colmap_lazyloc/math/selected_inverse.h"

#include <vector>

namespace lazyloc {

// Computes Z = A^-1 from the last column to the first. With l_i = L_ij / L_jj and sums over k > j:
//   Z_ij = -sum l_k Z_ik,   Z_jj = 1 / L_jj^2 - sum l_k Z_kj.
// Column j needs elements of Z only from columns to its right, and only those that are non-zero in L.
Eigen::SparseMatrix<double> SelectedInverse(Eigen::SparseMatrix<double> lower) {
  lower.makeCompressed();
  const Eigen::Index size = lower.cols();
  const int *begin_of = lower.outerIndexPtr(), *row_of = lower.innerIndexPtr();
  double* value_of = lower.valuePtr();  // overwritten column by column: L becomes Z
  std::vector<double> l(size, 0), sum(size, 0);
  std::vector<Eigen::Index> column_of_row(size, -1);  // processed last with an element in the row
  for (Eigen::Index j = size - 1; j >= 0; --j) {
    const int begin = begin_of[j], end = begin_of[j + 1];
    const double pivot = value_of[begin];
    for (int at = begin + 1; at < end; ++at) {
      l[row_of[at]] = value_of[at] / pivot;
      sum[row_of[at]] = 0;
      column_of_row[row_of[at]] = j;
    }
    for (int at = begin + 1; at < end; ++at) {
      const int k = row_of[at];
      sum[k] += l[k] * value_of[begin_of[k]];
      for (int below = begin_of[k] + 1; below < begin_of[k + 1]; ++below) {
        const int i = row_of[below];
        if (column_of_row[i] != j) continue;
        sum[i] += l[k] * value_of[below];
        sum[k] += l[i] * value_of[below];
      }
    }
    value_of[begin] = 1 / (pivot * pivot);
    for (int at = begin + 1; at < end; ++at) {
      value_of[at] = -sum[row_of[at]];
      value_of[begin] -= l[row_of[at]] * value_of[at];
    }
  }
  return lower;
}

}  // namespace lazyloc

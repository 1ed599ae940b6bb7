#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/math/vectorized.h"

namespace lazyloc {

// Computes block -= a b^T. Written with vectors of four and of two rows, because bundle adjustment spends most of its
// time here and compilers do not find this split. The result is the same with and without vector instructions.
template <int kRows>
LAZYLOC_ALWAYS_INLINE inline void SubtractProduct(const Eigen::Matrix<double, kRows, 3>& a,
                                                  const Eigen::Matrix<double, kRows, 3>& b,
                                                  Eigen::Matrix<double, kRows, kRows>* block) {
  static_assert(kRows >= 6);
  typedef double Four __attribute__((vector_size(32), aligned(8), may_alias));
  typedef double Two __attribute__((vector_size(16), aligned(8), may_alias));
  const double *a0 = a.data(), *a1 = a0 + kRows, *a2 = a1 + kRows;
  const Four a0_four = *reinterpret_cast<const Four*>(a0), a1_four = *reinterpret_cast<const Four*>(a1),
             a2_four = *reinterpret_cast<const Four*>(a2);
  const Two a0_two = *reinterpret_cast<const Two*>(a0 + 4), a1_two = *reinterpret_cast<const Two*>(a1 + 4),
            a2_two = *reinterpret_cast<const Two*>(a2 + 4);
  for (int col = 0; col < kRows; ++col) {
    const double b0 = b(col, 0), b1 = b(col, 1), b2 = b(col, 2);
    double* column = block->data() + kRows * col;
    *reinterpret_cast<Four*>(column) -= a0_four * b0 + a1_four * b1 + a2_four * b2;
    *reinterpret_cast<Two*>(column + 4) -= a0_two * b0 + a1_two * b1 + a2_two * b2;
    for (int row = 6; row < kRows; ++row) column[row] -= a0[row] * b0 + a1[row] * b1 + a2[row] * b2;
  }
}

}  // namespace lazyloc

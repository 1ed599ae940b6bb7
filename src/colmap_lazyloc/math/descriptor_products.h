#pragma once

#include <array>
#include <cstdint>

#include <Eigen/Core>

#include "colmap_lazyloc/math/vectorized.h"

// Scalar products of SIFT descriptors: what matching and the search for visual words spend their time on. Sums are
// taken in whole numbers, so they are exact, and the same on every processor.
namespace lazyloc {

constexpr int kDescriptorDim = 128;
constexpr int kMaxDescriptorProduct = kDescriptorDim * 255 * 255;
constexpr int kDescriptorBlock = 64;  // as many rows stay in a processor's first cache

using DescriptorRows = Eigen::Matrix<int16_t, Eigen::Dynamic, kDescriptorDim, Eigen::RowMajor>;
using BlockProducts = std::array<int32_t, kDescriptorBlock>;

// In blocks of block_size; the rows that fill up the last one are zero.
template <typename Derived>
DescriptorRows ToBlocks(const Eigen::MatrixBase<Derived>& descriptors, Eigen::Index block_size) {
  DescriptorRows rows((descriptors.rows() + block_size - 1) / block_size * block_size, kDescriptorDim);
  rows.topRows(descriptors.rows()) = descriptors.template cast<int16_t>();
  rows.bottomRows(rows.rows() - descriptors.rows()).setZero();
  return rows;
}

// Of the descriptor at `row` with each of a block.
LAZYLOC_ALWAYS_INLINE inline BlockProducts MultiplyBlock(const int16_t* __restrict row,
                                                         const int16_t* __restrict block) {
  BlockProducts products;
  for (int j = 0; j < kDescriptorBlock; ++j) {
    int32_t product = 0;
    for (int k = 0; k < kDescriptorDim; ++k) product += row[k] * block[j * kDescriptorDim + k];
    products[j] = product;
  }
  return products;
}

}  // namespace lazyloc

#pragma once

#include <array>
#include <cstdint>

#include <Eigen/Core>

#include "colmap_lazyloc/math/vectorized.h"

// Scalar products of SIFT descriptors. Matching and the search for visual words spend most of their time on them. The
// sums are integers, so that they are exact and the same on every processor.
namespace lazyloc {

constexpr int kDescriptorDim = 128;
constexpr int kMaxDescriptorProduct = kDescriptorDim * 255 * 255;
constexpr int kDescriptorBlock = 64;  // rows; a block is 16 KiB, which fits into a first-level cache

using DescriptorRows = Eigen::Matrix<int16_t, Eigen::Dynamic, kDescriptorDim, Eigen::RowMajor>;
using BlockProducts = std::array<int32_t, kDescriptorBlock>;

// Converts n x 128 descriptors to 16 bits and appends zero rows up to a multiple of block_size.
template <typename Derived>
DescriptorRows ToBlocks(const Eigen::MatrixBase<Derived>& descriptors, Eigen::Index block_size) {
  DescriptorRows rows((descriptors.rows() + block_size - 1) / block_size * block_size, kDescriptorDim);
  rows.topRows(descriptors.rows()) = descriptors.template cast<int16_t>();
  rows.bottomRows(rows.rows() - descriptors.rows()).setZero();
  return rows;
}

// Returns the products of one descriptor (kDescriptorDim values) with each of a block's kDescriptorBlock descriptors.
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

#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

// Scalar products of SIFT descriptors. Matching and the search for visual words spend most of their time on them. The
// sums are integers, so that they are exact and the same on every processor.
namespace lazyloc {

constexpr int kDescriptorLength = 128;  // numbers of a descriptor of SIFT or ALIKED
constexpr int kDescriptorRows = 4;      // number of rows in a tile of products
constexpr int kDescriptorBlock =
    64;  // number of columns in a tile; a block is 8 KiB, which fits into a first-level cache

// One row per keypoint: the numbers of SIFT, or the bytes of the other types' single-precision ones.
using Descriptors = Eigen::Matrix<uint8_t, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Integers that loops over all of them keep in vector registers.
constexpr int kNumLanes = 16;
constexpr int kAlignment = kNumLanes * sizeof(int32_t);
struct alignas(kAlignment) Lanes {
  int32_t values[kNumLanes];
};

// Products of kDescriptorRows descriptors with those of a block.
struct ProductTile {
  Lanes rows[kDescriptorRows][kDescriptorBlock / kNumLanes];
};

// Instructions that products are computed with.
enum class ProductInstructions {
  PLAIN,        // what the compiler may use on every processor
  AVX2,         // x86
  AVX_VNNI,     // x86: products of 8-bit integers
  AVX512_VNNI,  // the same in registers of twice the size
  DOT_PRODUCT,  // ARM: products of 8-bit integers
};

// Returns those that this processor has, the fastest one last.
std::vector<ProductInstructions> AvailableProductInstructions();
ProductInstructions FastestProductInstructions();

// The left factors of products.
class DescriptorRows {
 public:
  // descriptors: n x 128. Appends zero rows up to a multiple of kDescriptorRows.
  explicit DescriptorRows(const Descriptors& descriptors);

  int NumRows() const { return static_cast<int>(sums_.size()); }
  const uint8_t* Row(int row) const { return &values_[static_cast<size_t>(row) * kDescriptorLength]; }
  // Returns the sum of a row's values.
  const int32_t* Sum(int row) const { return &sums_[static_cast<size_t>(row)]; }

 private:
  std::vector<uint8_t> values_;
  std::vector<int32_t> sums_;
};

// The right factors of products, in blocks of kDescriptorBlock.
class DescriptorBlocks {
 public:
  // descriptors: n x 128. Appends zero rows up to a multiple of kDescriptorBlock.
  explicit DescriptorBlocks(const Descriptors& descriptors,
                            ProductInstructions instructions = FastestProductInstructions());

  int NumBlocks() const { return static_cast<int>(values_.size()) / kBlockSize; }
  // Computes the products of rows first_row, ..., first_row + kDescriptorRows - 1 with a block.
  void Multiply(const DescriptorRows& rows, int first_row, int block, ProductTile* products) const;

 private:
  static constexpr int kBlockSize = kDescriptorBlock * kDescriptorLength;

  // Holds, in each block, the first few values of each descriptor, then the next, as many as one step multiplies:
  // two with AVX2, four with VNNI and DOT_PRODUCT, else all. With VNNI, all are less 128, because its second factor is
  // signed.
  std::vector<uint8_t> values_;
  ProductInstructions instructions_;
};

}  // namespace lazyloc

#include "colmap_lazyloc/math/descriptor_products.h"

#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lazyloc {
namespace {

using ::testing::AllOf;
using ::testing::Ge;
using ::testing::Le;

Descriptors RandomBytes(int num_rows, uint32_t seed) {
  std::mt19937 random(seed);
  Descriptors bytes(num_rows, kDescriptorLength);
  for (Eigen::Index i = 0; i < bytes.size(); ++i) bytes.data()[i] = static_cast<uint8_t>(random());
  return bytes;
}

// Checks all products, and that padding has the product 0.
void ExpectExactProducts(const Descriptors& left, const Descriptors& right, ProductInstructions instructions) {
  const DescriptorRows rows(left);
  const DescriptorBlocks blocks(right, instructions);
  ASSERT_THAT(rows.NumRows(), AllOf(Ge(left.rows()), Le(left.rows() + kDescriptorRows - 1)));
  ASSERT_THAT(blocks.NumBlocks() * kDescriptorBlock, AllOf(Ge(right.rows()), Le(right.rows() + kDescriptorBlock - 1)));
  ProductTile products;
  for (int row = 0; row < rows.NumRows(); ++row) {
    for (int column = 0; column < blocks.NumBlocks() * kDescriptorBlock; ++column) {
      const int place = column % kDescriptorBlock;
      blocks.Multiply(rows, row / kDescriptorRows * kDescriptorRows, column / kDescriptorBlock, &products);
      const bool is_padding = row >= left.rows() || column >= right.rows();
      const int expected = is_padding ? 0 : left.row(row).cast<int>().dot(right.row(column).cast<int>());
      ASSERT_EQ(products.rows[row % kDescriptorRows][place / kNumLanes].values[place % kNumLanes], expected);
    }
  }
}

TEST(DescriptorProducts, AreExactWithAllInstructions) {
  for (const ProductInstructions instructions : AvailableProductInstructions()) {
    ExpectExactProducts(RandomBytes(9, 1), RandomBytes(130, 2), instructions);
    ExpectExactProducts(RandomBytes(1, 3), RandomBytes(64, 4), instructions);
    ExpectExactProducts(Descriptors::Constant(4, kDescriptorLength, 255),
                        Descriptors::Constant(65, kDescriptorLength, 255), instructions);
    ExpectExactProducts(Descriptors::Constant(1, kDescriptorLength, 255),
                        Descriptors::Constant(1, kDescriptorLength, 0), instructions);
  }
}

TEST(DescriptorProducts, NothingHasNoBlocks) {
  EXPECT_EQ(DescriptorRows(Descriptors(0, kDescriptorLength)).NumRows(), 0);
  EXPECT_EQ(DescriptorBlocks(Descriptors(0, kDescriptorLength)).NumBlocks(), 0);
}

}  // namespace
}  // namespace lazyloc

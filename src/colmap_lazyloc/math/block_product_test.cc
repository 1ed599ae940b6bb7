#include "colmap_lazyloc/math/block_product.h"

#include <type_traits>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

template <typename Rows>
class BlockProduct : public testing::Test {};
using Sizes = testing::Types<std::integral_constant<int, 6>, std::integral_constant<int, 7>>;
TYPED_TEST_SUITE(BlockProduct, Sizes);

TYPED_TEST(BlockProduct, EqualsTheMatrixProduct) {
  constexpr int kRows = TypeParam::value;
  const Eigen::Matrix<double, kRows, 3> a = Eigen::Matrix<double, kRows, 3>::Random(),
                                        b = Eigen::Matrix<double, kRows, 3>::Random();
  const Eigen::Matrix<double, kRows, kRows> start = Eigen::Matrix<double, kRows, kRows>::Random();
  Eigen::Matrix<double, kRows, kRows> plain = start, vectorized = start;
  SubtractProduct(a, b, &plain);
  RunVectorized([&]() LAZYLOC_ALWAYS_INLINE { SubtractProduct(a, b, &vectorized); });
  EXPECT_LE((plain - (start - a * b.transpose())).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_EQ(plain, vectorized) << "the same to the last bit on every processor";
}

}  // namespace
}  // namespace lazyloc

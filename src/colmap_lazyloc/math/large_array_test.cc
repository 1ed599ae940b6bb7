#include "colmap_lazyloc/math/large_array.h"

#include <algorithm>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

TEST(AllocateLargeArray, HasAllValues) {
  for (const size_t size : {0u, 1u, 300000u, 600001u}) {
    const LargeArray values = AllocateLargeArray(size), others = AllocateLargeArray(size);
    ASSERT_NE(values, nullptr);
    std::fill_n(values.get(), size, 1.0f);
    std::fill_n(others.get(), size, 2.0f);
    EXPECT_EQ(std::count(values.get(), values.get() + size, 1.0f), static_cast<std::ptrdiff_t>(size));
  }
}

TEST(AllocateLargeArray, UsesReleasedMemoryAgain) {
  LargeArray values = AllocateLargeArray(3000000);
  const float* const memory = values.get();
  values.reset();
  EXPECT_NE(AllocateLargeArray(2000000).get(), memory) << "too large";
  EXPECT_NE(AllocateLargeArray(4000000).get(), memory) << "too small";
  values = AllocateLargeArray(2900000);
  EXPECT_EQ(values.get(), memory);
  EXPECT_NE(AllocateLargeArray(2900000).get(), memory) << "still in use";
}

}  // namespace
}  // namespace lazyloc

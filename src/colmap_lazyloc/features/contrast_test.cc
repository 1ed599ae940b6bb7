#include "colmap_lazyloc/features/contrast.h"

#include <algorithm>
#include <random>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

TEST(FullContrast, LeavesOutTheDarkestAndTheBrightestValues) {
  std::vector<uint8_t> values(1000);
  for (int i = 0; i < 1000; ++i) values[i] = static_cast<uint8_t>(100 + i / 10);  // 100 .. 199, ten of each
  std::shuffle(values.begin(), values.end(), std::mt19937(1));
  const Contrast contrast = FullContrast(values);
  EXPECT_EQ(contrast.black, 101);
  EXPECT_EQ(contrast.white, 198);
}

TEST(FullContrast, OfOneValueHasARange) {
  for (const int value : {0, 255}) {
    const Contrast contrast = FullContrast({static_cast<uint8_t>(value)});
    EXPECT_EQ(contrast.black, value);
    EXPECT_EQ(contrast.white, value + 1);
  }
}

}  // namespace
}  // namespace lazyloc

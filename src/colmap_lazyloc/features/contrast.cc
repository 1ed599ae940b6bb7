#include "colmap_lazyloc/features/contrast.h"

#include <algorithm>
#include <cstddef>

namespace lazyloc {

Contrast FullContrast(std::vector<uint8_t> values) {
  constexpr double kClippedRatio = 0.01;  // at either end: a few pixels may be far from all others
  const auto value_at = [&](std::ptrdiff_t rank) {
    std::nth_element(values.begin(), values.begin() + rank, values.end());
    return int{values[static_cast<size_t>(rank)]};
  };
  const auto last = static_cast<std::ptrdiff_t>(values.size()) - 1;
  const auto rank = static_cast<std::ptrdiff_t>(kClippedRatio * static_cast<double>(values.size()));
  const int black = value_at(rank), white = value_at(last - rank);
  return {black, std::max(black + 1, white)};
}

}  // namespace lazyloc

#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace lazyloc {

// The nearest neighbour of a SIFT descriptor in the other image: its index, and the largest and second largest product.
struct NearestDescriptor {
  int index = -1;
  int32_t best = 0, second = 0;

  // Adds descriptors of the other image of which the one at `new_index` is the nearest. Among equal ones, the first is
  // kept.
  void Add(int new_index, int32_t new_best, int32_t new_second) {
    second = std::max({second, new_second, std::min(best, new_best)});
    if (new_best > best || (new_best == best && new_best > 0 && new_index < index)) index = new_index;
    best = std::max(best, new_best);
  }

  // Returns the index if the neighbour is near enough and clearly the nearest, else -1.
  int Match() const {
    // Every descriptor has this length. The bounds are COLMAP's defaults.
    constexpr float kSquaredLength = 512 * 512, kMaxAngleRad = 0.7f, kMaxRatio = 0.8f;
    if (index < 0) return -1;
    const float angle = std::acos(std::min(static_cast<float>(best) / kSquaredLength, 1.0f));
    const float second_angle = std::acos(std::min(static_cast<float>(second) / kSquaredLength, 1.0f));
    const bool is_good = angle <= kMaxAngleRad && angle < kMaxRatio * second_angle;
    return is_good ? index : -1;
  }
};

}  // namespace lazyloc

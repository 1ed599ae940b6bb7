#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <map>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

// Hands out ids that no image, camera, rig or frame has: above the largest one in use.
class FreeIds {
 public:
  FreeIds() = default;
  template <typename T>
  explicit FreeIds(const std::map<uint32_t, T>& used) {
    if (!used.empty()) Use(used.rbegin()->first);
  }

  void Use(uint32_t id) { largest_ = std::max(largest_, id); }
  // Throws InputError if no id is left, because COLMAP marks "no id" by the largest number.
  uint32_t Next() {
    if (largest_ >= std::numeric_limits<uint32_t>::max() - 1) {
      throw InputError("no id is left for the queries: the ids of the model or database reach the largest number");
    }
    return ++largest_;
  }

 private:
  uint32_t largest_ = 0;
};

// Returns the preferred id if it is free, else one above all others.
template <typename T>
uint32_t FreeId(uint32_t preferred, const std::map<uint32_t, T>& used) {
  return used.count(preferred) == 0 ? preferred : FreeIds(used).Next();
}

}  // namespace lazyloc

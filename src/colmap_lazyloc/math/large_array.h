#pragma once

#include <cstddef>
#include <memory>

namespace lazyloc {

// Returns memory to where AllocateLargeArray had it from.
struct ReleaseMemory {
  size_t num_pages = 0;  // 0: less than a large page

  void operator()(void* memory) const;
};
using LargeArray = std::unique_ptr<float[], ReleaseMemory>;

// Returns `size` values that are not initialized. They are in large pages if the system has any, and in pages that were
// used before, because the first use of each page takes the system's time: with small pages half of the time of an
// image's smoothing, with large ones a quarter of that of a photo's localization. Thread-safe.
LargeArray AllocateLargeArray(size_t size);

}  // namespace lazyloc

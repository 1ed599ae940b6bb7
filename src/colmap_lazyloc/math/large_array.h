#pragma once

#include <cstddef>
#include <cstdlib>
#include <memory>

namespace lazyloc {

struct FreeMemory {
  void operator()(void* memory) const { std::free(memory); }
};
using LargeArray = std::unique_ptr<float[], FreeMemory>;

// Returns `size` values that are not initialized. They are in large pages if the system has any, because the first use
// of each page takes the system's time: half of the time of an image's smoothing with small pages.
LargeArray AllocateLargeArray(size_t size);

}  // namespace lazyloc

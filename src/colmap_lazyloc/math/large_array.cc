#include "colmap_lazyloc/math/large_array.h"

#include <new>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace lazyloc {

LargeArray AllocateLargeArray(size_t size) {
  constexpr size_t kPage = 2 << 20;
  const size_t num_pages = (size * sizeof(float) + kPage - 1) / kPage;
  // Less than half of a large page would waste more than it uses.
  const bool is_large = size * sizeof(float) >= kPage / 2;
  void* memory = is_large ? std::aligned_alloc(kPage, num_pages * kPage) : std::malloc(size * sizeof(float) + 1);
  if (memory == nullptr) throw std::bad_alloc();
#if defined(__linux__)
  if (is_large) madvise(memory, num_pages * kPage, MADV_HUGEPAGE);  // a request; the array is right without, too
#endif
  return LargeArray(static_cast<float*>(memory));
}

}  // namespace lazyloc

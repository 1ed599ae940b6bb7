#include "colmap_lazyloc/math/large_array.h"

#include <cstdlib>
#include <mutex>
#include <new>
#include <vector>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace lazyloc {
namespace {

constexpr size_t kPage = 2 << 20;
// Enough for two photos of 2 megapixels at a time. More memory would stay in use by programs that only wait.
constexpr size_t kMaxNumKeptPages = 192;

// Keeps released memory for the next array of about the same size.
class KeptMemory {
 public:
  KeptMemory() { blocks_.reserve(kMaxNumKeptPages + 1); }

  // Returns null if nothing fits.
  void* Take(size_t* num_pages) {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (auto block = blocks_.begin(); block != blocks_.end(); ++block) {
      if (block->num_pages < *num_pages || block->num_pages > *num_pages + *num_pages / 4) continue;
      void* memory = block->memory;
      *num_pages = block->num_pages;
      num_pages_ -= block->num_pages;
      blocks_.erase(block);
      return memory;
    }
    return nullptr;
  }

  void Keep(void* memory, size_t num_pages) {
    if (num_pages > kMaxNumKeptPages) {
      std::free(memory);
      return;
    }
    const std::lock_guard<std::mutex> lock(mutex_);
    blocks_.push_back({memory, num_pages});
    num_pages_ += num_pages;
    while (num_pages_ > kMaxNumKeptPages) FreeOldest();
  }

  void FreeAll() {
    const std::lock_guard<std::mutex> lock(mutex_);
    while (!blocks_.empty()) FreeOldest();
  }

 private:
  struct Block {
    void* memory;
    size_t num_pages;
  };

  void FreeOldest() {
    num_pages_ -= blocks_.front().num_pages;
    std::free(blocks_.front().memory);
    blocks_.erase(blocks_.begin());
  }

  std::mutex mutex_;
  std::vector<Block> blocks_;  // the oldest first; each has a page or more, so that it never grows
  size_t num_pages_ = 0;       // of all blocks
};

KeptMemory& Kept() {
  static auto* const kept = new KeptMemory;  // never destroyed, since other threads may outlive it
  return *kept;
}

}  // namespace

void ReleaseMemory::operator()(void* memory) const {
  if (num_pages == 0) {
    std::free(memory);
  } else {
    Kept().Keep(memory, num_pages);
  }
}

LargeArray AllocateLargeArray(size_t size) {
  size_t num_pages = (size * sizeof(float) + kPage - 1) / kPage;
  // Less than half of a large page would waste more than it uses.
  if (size * sizeof(float) < kPage / 2) num_pages = 0;
  void* memory = num_pages == 0 ? std::malloc(size * sizeof(float) + 1) : Kept().Take(&num_pages);
  if (memory == nullptr && num_pages > 0) {
    memory = std::aligned_alloc(kPage, num_pages * kPage);
    if (memory == nullptr) {
      Kept().FreeAll();
      memory = std::aligned_alloc(kPage, num_pages * kPage);
    }
#if defined(__linux__)
    // A request; the array is right without, too.
    if (memory != nullptr) madvise(memory, num_pages * kPage, MADV_HUGEPAGE);
#endif
  }
  if (memory == nullptr) throw std::bad_alloc();
  return LargeArray(static_cast<float*>(memory), ReleaseMemory{num_pages});
}

}  // namespace lazyloc

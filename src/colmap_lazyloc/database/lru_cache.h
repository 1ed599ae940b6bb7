#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <utility>

namespace lazyloc {

// Keeps the values that were used last, by the id of their image, because many queries share database images.
// Thread-safe.
template <typename Value>
class LruCache {
 public:
  using Size = std::function<size_t(const Value&)>;

  // The sizes of all values add up to at most max_size, 32 MiB by default; a larger value is not kept.
  explicit LruCache(Size size, size_t max_size = 32 << 20) : max_size_(max_size), size_(std::move(size)) {}

  // Returns the kept value, or the one that `read` returns. Two threads may read the same value at once.
  std::shared_ptr<const Value> Get(uint32_t image_id, const std::function<Value()>& read) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      const auto entry = entry_of_image_.find(image_id);
      if (entry != entry_of_image_.end()) {
        entries_.splice(entries_.begin(), entries_, entry->second);
        return entry->second->second;
      }
    }
    auto value = std::make_shared<const Value>(read());
    const std::lock_guard<std::mutex> lock(mutex_);
    if (entry_of_image_.count(image_id) > 0) return value;  // another thread was faster
    entries_.emplace_front(image_id, value);
    entry_of_image_.emplace(image_id, entries_.begin());
    used_size_ += size_(*value);
    while (used_size_ > max_size_) {
      used_size_ -= size_(*entries_.back().second);
      entry_of_image_.erase(entries_.back().first);
      entries_.pop_back();
    }
    return value;
  }

 private:
  using Entries = std::list<std::pair<uint32_t, std::shared_ptr<const Value>>>;

  const size_t max_size_;
  const Size size_;
  size_t used_size_ = 0;
  std::mutex mutex_;
  Entries entries_;  // in order of use, the last one first
  std::unordered_map<uint32_t, typename Entries::iterator> entry_of_image_;
};

}  // namespace lazyloc

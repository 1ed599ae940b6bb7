#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <unordered_map>
#include <utility>
#include <vector>

#include <Eigen/Core>

namespace lazyloc {

// Keypoints of the images that were used last: many queries share database images. It holds up to max_num_keypoints in
// all (8 bytes each), or those of one image that has more.
class KeypointCache {
 public:
  using Keypoints = std::vector<Eigen::Vector2f>;  // xy in pixels, as COLMAP stores them

  explicit KeypointCache(size_t max_num_keypoints) : max_num_keypoints_(max_num_keypoints) {}

  // Null where the image's keypoints are not held. Valid until the next Add, as what Add returns.
  const Keypoints* Find(uint32_t image_id) {
    const auto entry = entry_of_image_.find(image_id);
    if (entry == entry_of_image_.end()) return nullptr;
    entries_.splice(entries_.begin(), entries_, entry->second);
    return &entry->second->second;
  }

  // Of an image that is not held. Makes room by forgetting what was not used for longest.
  const Keypoints* Add(uint32_t image_id, Keypoints keypoints) {
    num_keypoints_ += keypoints.size();
    entries_.emplace_front(image_id, std::move(keypoints));
    entry_of_image_.emplace(image_id, entries_.begin());
    while (num_keypoints_ > max_num_keypoints_ && entries_.size() > 1) {
      num_keypoints_ -= entries_.back().second.size();
      entry_of_image_.erase(entries_.back().first);
      entries_.pop_back();
    }
    return &entries_.front().second;
  }

 private:
  using Entries = std::list<std::pair<uint32_t, Keypoints>>;  // used last comes first

  size_t max_num_keypoints_;
  size_t num_keypoints_ = 0;
  Entries entries_;
  std::unordered_map<uint32_t, Entries::iterator> entry_of_image_;
};

}  // namespace lazyloc

#include "colmap_lazyloc/matching/feature_cache.h"

namespace lazyloc {
namespace {

double NumBytes(const Features& features) {
  return static_cast<double>(features.keypoints.size() * sizeof(Keypoint)) +
         static_cast<double>(features.descriptors.size());
}

}  // namespace

std::shared_ptr<const Features> FeatureCache::Get(uint32_t image_id, const FeatureReader& reader) {
  const auto find = [&]() -> std::shared_ptr<const Features> {
    const auto entry = entry_of_image_.find(image_id);
    if (entry == entry_of_image_.end()) return nullptr;
    entries_.splice(entries_.begin(), entries_, entry->second);
    return entry->second->second;
  };
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (auto features = find()) return features;
  }
  auto features = std::make_shared<const Features>(reader.Read(image_id));
  const std::lock_guard<std::mutex> lock(mutex_);
  if (auto found = find()) return found;  // another thread was faster
  entries_.emplace_front(image_id, features);
  entry_of_image_[image_id] = entries_.begin();
  num_bytes_ += NumBytes(*features);
  while (num_bytes_ > max_num_bytes_ && !entries_.empty()) {
    num_bytes_ -= NumBytes(*entries_.back().second);
    entry_of_image_.erase(entries_.back().first);
    entries_.pop_back();
  }
  return features;
}

}  // namespace lazyloc

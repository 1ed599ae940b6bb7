#pragma once

#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <utility>

#include "colmap_lazyloc/database/feature_reader.h"
#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// Features of the database images that were used last, within a limit of memory. Thread-safe.
class FeatureCache {
 public:
  explicit FeatureCache(double max_gb) : max_num_bytes_(max_gb * 1e9) {}

  // From the cache, or read from the database (by the calling thread's reader).
  std::shared_ptr<const Features> Get(uint32_t image_id, const FeatureReader& reader);

 private:
  using Entry = std::pair<uint32_t, std::shared_ptr<const Features>>;

  const double max_num_bytes_;
  double num_bytes_ = 0;
  std::mutex mutex_;
  std::list<Entry> entries_;  // used last: first
  std::unordered_map<uint32_t, std::list<Entry>::iterator> entry_of_image_;
};

}  // namespace lazyloc

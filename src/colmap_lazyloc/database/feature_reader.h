#pragma once

#include <cstdint>
#include <filesystem>
#include <map>

#include "colmap_lazyloc/database/sqlite.h"
#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// Reads the features of a COLMAP database, as strictly read-only as DatabaseReader and with its errors. SIFT only:
// other descriptors are an InputError. One connection: use one reader per thread.
class FeatureReader {
 public:
  explicit FeatureReader(const std::filesystem::path& path);

  const std::filesystem::path& Path() const { return connection_.File().Path(); }
  // Number of descriptors of each image that has some. Reads no descriptor.
  std::map<uint32_t, size_t> ReadDescriptorCounts() const;
  // As many keypoints as descriptors; both empty where the image has none. Descriptors have 128 columns.
  Features Read(uint32_t image_id) const;

 private:
  SqliteConnection connection_;
  SqliteStatement counts_, keypoints_, descriptors_;
};

}  // namespace lazyloc

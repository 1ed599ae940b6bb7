#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "colmap_lazyloc/database/sqlite.h"
#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// The number of descriptors by image, for images that have any.
struct DescriptorCounts {
  FeatureType type = FeatureType::SIFT;  // of all of them
  std::map<uint32_t, size_t> of_image;
};

// Reads the features of a COLMAP database without writing, like DatabaseReader and with its errors. Has one
// connection: use one reader per thread.
class FeatureReader {
 public:
  explicit FeatureReader(const std::filesystem::path& path);

  const std::filesystem::path& Path() const { return connection_.File().Path(); }
  // Counts the descriptors without reading them. Leaves out images whose record is damaged, and appends the damage to
  // `damages` unless it is null. Throws InputError if there are descriptors of several types.
  DescriptorCounts ReadDescriptorCounts(std::vector<std::string>* damages = nullptr) const;
  // Returns the keypoints of an image; empty if it has none.
  std::vector<Keypoint> ReadKeypoints(uint32_t image_id) const;
  // Returns as many keypoints as descriptors; both are empty if the image has none.
  Features Read(uint32_t image_id) const;

 private:
  SqliteConnection connection_;
  SqliteStatement counts_, keypoints_, descriptors_;
};

}  // namespace lazyloc

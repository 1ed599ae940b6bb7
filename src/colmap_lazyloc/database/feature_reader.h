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

// Where a retrieval index has features from, by the ids of images in a database.
class FeatureSource {
 public:
  virtual ~FeatureSource() = default;

  // Returns the file or folder that errors name.
  virtual const std::filesystem::path& Path() const = 0;
  // Returns a text that stays the same as long as all features do.
  virtual std::string StateText() const = 0;
  // Counts the descriptors of images that can be read.
  virtual DescriptorCounts Counts() const = 0;
  // Returns as many keypoints as descriptors. Throws DamagedRecordError.
  virtual Features Read(uint32_t image_id) const = 0;
};

// Reads the features of a COLMAP database without writing, like DatabaseReader and with its errors. Has one
// connection: use one reader per thread.
class FeatureReader : public FeatureSource {
 public:
  explicit FeatureReader(const std::filesystem::path& path);

  const std::filesystem::path& Path() const override { return connection_.File().Path(); }
  std::string StateText() const override { return connection_.File().StateText(); }
  DescriptorCounts Counts() const override { return ReadDescriptorCounts(); }
  // Counts the descriptors without reading them. Leaves out images whose record is damaged, and appends the damage to
  // `damages` unless it is null. Throws InputError if there are descriptors of several types.
  DescriptorCounts ReadDescriptorCounts(std::vector<std::string>* damages = nullptr) const;
  // True if the version of the database has the direction of gravity in images. COLMAP from that version on extracts
  // features from photos that it has turned upright.
  bool HasGravity() const;
  // Returns the keypoints of an image; empty if it has none.
  std::vector<Keypoint> ReadKeypoints(uint32_t image_id) const;
  // Returns as many keypoints as descriptors; both are empty if the image has none.
  Features Read(uint32_t image_id) const override;

 private:
  SqliteConnection connection_;
  SqliteStatement counts_, keypoints_, descriptors_;
};

}  // namespace lazyloc

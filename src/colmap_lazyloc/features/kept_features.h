#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// Features of image files in a folder with a file for each image. Such a file belongs to one way of extraction and to
// the content of the image file; one that does not fit or is damaged is made anew. Thread-safe; other processes may use
// the folder at the same time, because a file that is not complete counts as none.
class KeptFeatures {
 public:
  using Extract = std::function<std::optional<Features>()>;

  // folder: made when it is needed; empty: keeps nothing.
  explicit KeptFeatures(std::filesystem::path folder) : folder_(std::move(folder)) {}

  // Returns the features of an image file: the kept ones, or what `extract` returns. key: what they depend on besides
  // the file. Keeps nothing if the folder cannot be written, because results do not depend on it.
  std::optional<Features> Get(const std::string& image_name, const std::filesystem::path& image_path,
                              const std::string& key, FeatureType type, const Extract& extract) const;

 private:
  const std::filesystem::path folder_;
};

}  // namespace lazyloc

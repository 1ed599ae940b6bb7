#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "colmap_lazyloc/features/feature_method.h"

namespace lazyloc {

// Features of database images that have other ones in the database: extracted from the image files when they are
// needed, and kept in a folder with a file for each image. Such a file belongs to one method, its options, and the
// content of the image file; one that does not fit or is damaged is made anew. Thread-safe; other processes may use the
// folder at the same time, because a file appears when it is complete.
class ExtractedFeatures {
 public:
  // folder: made when it is needed; empty: keeps nothing. method must outlive this.
  ExtractedFeatures(const FeatureMethod& method, std::filesystem::path image_path, std::filesystem::path folder);

  // Returns nullopt if the image file is missing or damaged, or is not of the size of its camera. Keeps nothing if the
  // folder cannot be written, because results do not depend on it.
  std::optional<Features> Get(const std::string& image_name, const Camera& camera) const;
  bool HasFile(const std::string& image_name) const;

 private:
  std::optional<Features> ReadKept(const std::filesystem::path& path, const std::string& key) const;
  void Keep(const std::filesystem::path& path, const std::string& key, const Features& features) const;

  const FeatureMethod& method_;
  const std::filesystem::path image_path_, folder_;
};

}  // namespace lazyloc

#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "colmap_lazyloc/features/feature_method.h"
#include "colmap_lazyloc/features/kept_features.h"

namespace lazyloc {

// Features of database images that the database does not have: extracted from the image files when they are needed, and
// kept in a folder. Thread-safe.
class ExtractedFeatures {
 public:
  // folder: as of KeptFeatures. method must outlive this.
  ExtractedFeatures(const FeatureMethod& method, std::filesystem::path image_path, std::filesystem::path folder);

  // Returns nullopt if the image file is missing or damaged, or is not of the size of its camera.
  std::optional<Features> Get(const std::string& image_name, const Camera& camera) const;
  bool HasFile(const std::string& image_name) const;

 private:
  const FeatureMethod& method_;
  const std::filesystem::path image_path_;
  const KeptFeatures kept_;
};

}  // namespace lazyloc

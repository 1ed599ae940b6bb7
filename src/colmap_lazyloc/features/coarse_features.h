#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "colmap_lazyloc/database/feature_reader.h"
#include "colmap_lazyloc/features/kept_features.h"
#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// Extracts SIFT features of database images for retrieval alone: those of the largest scales, from photos that are read
// at a reduced size. They take a tenth of the time of all features. Thread-safe.
class CoarseExtraction {
 public:
  // folder: as of KeptFeatures.
  CoarseExtraction(std::filesystem::path image_path, std::filesystem::path folder)
      : image_path_(std::move(image_path)), kept_(std::move(folder)) {}

  // Returns nullopt if the photo cannot be read.
  std::optional<Features> Get(const std::string& image_name) const;
  const std::filesystem::path& ImagePath() const { return image_path_; }

 private:
  const std::filesystem::path image_path_;
  const KeptFeatures kept_;
};

// The coarse features of all database images, for an index.
class CoarseFeatures : public FeatureSource {
 public:
  // names: of the images, by their ids. Leaves out photos that cannot be read.
  CoarseFeatures(const CoarseExtraction& extraction, const std::map<uint32_t, std::string>& names,
                 IdleThreads* idle_threads);

  const std::filesystem::path& Path() const override { return image_path_; }
  std::string StateText() const override { return state_; }
  DescriptorCounts Counts() const override;
  Features Read(uint32_t image_id) const override { return features_.at(image_id); }

 private:
  const std::filesystem::path image_path_;
  std::string state_;
  std::map<uint32_t, Features> features_;
};

// Returns how many features of a SIFT query match the coarse features of each image, among the largest ones of the
// query; 0 for an image without features.
std::vector<size_t> CountCoarseMatches(const Features& query,
                                       const std::vector<std::shared_ptr<const std::optional<Features>>>& coarse,
                                       IdleThreads* idle_threads);

}  // namespace lazyloc

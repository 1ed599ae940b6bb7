#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>

#include "colmap_lazyloc/database/feature_reader.h"
#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// SIFT features of database images for retrieval alone: those of the largest scales, from photos that are read at a
// reduced size. They take a tenth of the time of all features.
class CoarseFeatures : public FeatureSource {
 public:
  // names: of the images below image_path, by their ids. folder: keeps the features, as KeptFeatures does, so that an
  // index that was interrupted goes on. Leaves out photos that cannot be read.
  CoarseFeatures(std::filesystem::path image_path, const std::map<uint32_t, std::string>& names,
                 const std::filesystem::path& folder, IdleThreads* idle_threads);

  const std::filesystem::path& Path() const override { return image_path_; }
  std::string StateText() const override { return state_; }
  DescriptorCounts Counts() const override;
  Features Read(uint32_t image_id) const override { return features_.at(image_id); }

 private:
  const std::filesystem::path image_path_;
  std::string state_;
  std::map<uint32_t, Features> features_;
};

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <string>
#include <unordered_map>
#include <unordered_set>

#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// Collects a model while it is read, and refuses impossible parts of it in either format.
class ModelBuilder {
 public:
  // Return why the part was refused; empty if it was added. Cameras come first, then rigs, frames and images.
  std::string Add(const Camera& camera);
  std::string Add(const Rig& rig);
  std::string Add(const ModelFrame& frame);
  std::string Add(ModelImage image);
  // Returns the model with its images sorted by name. Call it once, at the end.
  Model Take();

 private:
  Model model_;
  std::unordered_map<uint64_t, uint32_t> camera_of_framed_image_;
  std::unordered_set<uint32_t> image_ids_;
  std::unordered_set<std::string> names_;
};

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <vector>

#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// A posed image that photos can be matched with.
struct DatabaseCandidate {
  const ModelImage* image = nullptr;
  uint32_t image_id = 0;  // in the database
  bool is_stored = true;  // false if the database does not have its descriptors, which are extracted on demand
};
using DatabaseCandidates = std::vector<const DatabaseCandidate*>;

}  // namespace lazyloc

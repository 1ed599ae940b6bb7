#include "colmap_lazyloc/loading/photo_options.h"

#include <algorithm>

#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {

bool PhotoOptions::CheckImagePath(std::string* error) const {
  if (image_path.empty() && on_demand) {
    *error = "on_demand needs --image_path, the folder of the database images";
    return false;
  }
  if (!image_path.empty() || (retrieval_index_path.empty() && matches_output_path.empty())) return true;
  *error = std::string(retrieval_index_path.empty() ? "matches_output_path" : "retrieval_index_path") +
           " needs --image_path, because it is for photos";
  return false;
}

bool PhotoOptions::Check(std::string* error) const {
  OPTION_GE(cache_gb, 0);
  return features.Check(error);
}

size_t PhotoOptions::CacheBytes() const { return static_cast<size_t>(std::min(cache_gb * 1e9, 1e18)); }

}  // namespace lazyloc

#include "colmap_lazyloc/loading/photo_options.h"

#include <algorithm>
#include <utility>

#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {

bool PhotoOptions::CheckImagePath(std::string* error) const {
  if (image_path.empty() && on_demand) {
    *error = "on_demand needs --image_path, the folder of the database images";
    return false;
  }
  if (!image_path.empty()) return true;
  for (const auto& [name, path] : {std::pair{"retrieval_index_path", &retrieval_index_path},
                                   {"matches_output_path", &matches_output_path},
                                   {"photo_position_path", &position_path}}) {
    if (path->empty()) continue;
    *error = std::string(name) + " needs --image_path, because it is for photos";
    return false;
  }
  return true;
}

bool PhotoOptions::Check(std::string* error) const {
  OPTION_GE(cache_gb, 0);
  return features.Check(error);
}

size_t PhotoOptions::CacheBytes() const { return static_cast<size_t>(std::min(cache_gb * 1e9, 1e18)); }

}  // namespace lazyloc

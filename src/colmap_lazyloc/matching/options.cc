#include "colmap_lazyloc/matching/options.h"

#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {

bool PhotoMatchingOptions::Check(std::string* error) const {
  OPTION_GE(max_num_exhaustive, 0);
  OPTION_GE(cache_gb, 0);
  return true;
}

bool RetrievalOptions::Check(std::string* error) const {
  OPTION_GE(num_visual_words, 2);
  if (max_num_features < 1 && max_num_features != -1) {
    // Gives the full name, because SiftExtraction has an option with the same last part.
    *error = "LazyIndexer.max_num_features must be >= 1, or -1";
    return false;
  }
  return true;
}

}  // namespace lazyloc

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
  return true;
}

}  // namespace lazyloc

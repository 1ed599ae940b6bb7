#pragma once

#include <string>

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/matching/descriptor_matching.h"

namespace lazyloc {

// Options for photos, which are matched in memory.
struct PhotoMatchingOptions {
  SiftExtractionOptions extraction;
  SiftMatchingOptions matching;
  int max_num_exhaustive = 50;  // a photo is matched with every database image if there are at most this many
  double cache_gb = 1;          // memory for the features of database images

  bool Check(std::string* error) const;
};

struct RetrievalOptions {
  int num_visual_words = 16384;  // maximum; a small database has fewer, because too few descriptors make bad words
  int max_num_features = -1;     // per image that is added: those of the largest scales; -1 for all

  bool Check(std::string* error) const;
};

}  // namespace lazyloc

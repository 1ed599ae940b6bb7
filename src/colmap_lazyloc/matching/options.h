#pragma once

#include <string>

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/matching/descriptor_matching.h"

namespace lazyloc {

// Of photos that are matched in memory.
struct PhotoMatchingOptions {
  SiftExtractionOptions extraction;
  SiftMatchingOptions matching;
  int max_num_exhaustive = 50;  // up to as many database images are all compared, without retrieval
  double cache_gb = 1;          // memory for features of database images

  bool Check(std::string* error) const;
};

struct RetrievalOptions {
  int num_visual_words = 16384;  // at most; small databases have fewer
  int num_threads = -1;          // of making the index; -1: the number of cores
  int seed = 0;

  bool Check(std::string* error) const;
};

}  // namespace lazyloc

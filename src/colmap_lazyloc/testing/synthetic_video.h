#pragma once

#include "colmap_lazyloc/testing/synthetic_group.h"

namespace lazyloc {

struct SyntheticVideoOptions {
  int num_queries = 10;
  int num_points_per_length = 8;  // a camera sees points along a length of about ten
  double pixel_noise_px = 0.5;
  uint32_t seed = 0;
};

// Lone queries along a straight path at distances of 0.5, looking sideways, beside database images at distances of 1:
// each shares matches with the database images up to 2 away, and with the two queries before it.
SyntheticGroup MakeSyntheticVideo(const SyntheticVideoOptions& options);

}  // namespace lazyloc

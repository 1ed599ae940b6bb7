#pragma once

#include "colmap_lazyloc/testing/synthetic_group.h"

namespace lazyloc {

struct SyntheticVideoOptions {
  int num_queries = 10;
  int num_points_per_length = 8;  // points per unit of the path; a camera observes about ten units
  double pixel_noise_px = 0.5;
  uint32_t seed = 0;
};

// Makes single queries along a straight path at intervals of 0.5, looking sideways, and database images beside the path
// at intervals of 1. Each query shares matches with the database images within a distance of 2 and with the two queries
// before it.
SyntheticGroup MakeSyntheticVideo(const SyntheticVideoOptions& options);

}  // namespace lazyloc

#pragma once

#include <colmap/optim/ransac.h>

namespace lazyloc {

// Returns the options of COLMAP's incremental triangulator, which tries all pairs of observations of a short track.
// max_error_rad: maximum angular error of an inlier.
inline colmap::RANSACOptions TriangulationRansacOptions(int num_observations, double max_error_rad) {
  constexpr int kMaxNumForAllPairs = 15;
  colmap::RANSACOptions options;
  if (num_observations <= kMaxNumForAllPairs) options.min_num_trials = num_observations * (num_observations - 1) / 2;
  options.max_error = max_error_rad;
  options.min_inlier_ratio = 0.02;
  options.confidence = 0.9999;
  options.max_num_trials = 10000;
  return options;
}

}  // namespace lazyloc

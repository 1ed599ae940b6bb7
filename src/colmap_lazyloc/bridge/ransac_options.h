#pragma once

#include <colmap/optim/ransac.h>

namespace lazyloc {

// Returns the options for absolute poses of single cameras and of rigs. max_error: in the unit of the square root of
// the estimator's residuals.
inline colmap::RANSACOptions AbsolutePoseRansacOptions(double max_error, double min_inlier_ratio) {
  colmap::RANSACOptions options;
  options.max_error = max_error;
  options.min_inlier_ratio = min_inlier_ratio;
  options.confidence = 0.9999;
  options.min_num_trials = 20;
  options.max_num_trials = 5000;
  return options;
}

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

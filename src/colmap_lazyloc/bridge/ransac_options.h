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

}  // namespace lazyloc

#pragma once

#include <vector>

#include "colmap_lazyloc/refinement/prior_fit.h"
#include "colmap_lazyloc/scene/frame.h"

namespace lazyloc {

// What is expected of a component before the adjustment: the log of its standard deviation is normally distributed.
struct ExpectedStddev {
  double median = 1;
  double log_stddev = 1;
  double min = 0.01;
  double first = 1;  // where the search for the maximum starts
};

// Returns the variances of a group's components that are most likely by the images and the expectations. fit: of an
// adjustment under the variances of `group`, which must have converged; variance_factor: that of its images.
//
// The marginal likelihood is that of the linearised adjustment (type-II maximum likelihood; REML). With A the
// information of the images over the variance factor, p the deviations, Q their precision and Q_0 that under the
// variances of `group`, its log is up to a constant
//   (log |Q| - log |A + Q| + b^T (A + Q)^-1 b) / 2,   b = A p + Q_0 p / variance_factor.
std::vector<double> EstimateVariances(const PriorGroup& group, const PriorFit& fit, double variance_factor,
                                      const std::vector<ExpectedStddev>& expected);

}  // namespace lazyloc

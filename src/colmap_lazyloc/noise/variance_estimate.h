#pragma once

#include <limits>
#include <vector>

#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/scene/database_pose_noise.h"
#include "colmap_lazyloc/scene/frame.h"

namespace lazyloc {

// What images say of the deviations p of a group's frames: up to a constant, the log of their likelihood is
// b^T p - p^T A p / 2. One coordinate of all frames after the other.
struct DeviationLikelihood {
  Eigen::MatrixXd information;  // A
  Eigen::VectorXd rhs;          // b
};

struct VarianceEstimate {
  std::vector<double> variances;  // by component
  // Log of the Bayes factor of such deviations over none: how many times more probable the images are if the components
  // have the expected sizes than if all deviations are zero (Laplace's approximation). Negative if the images show that
  // there are no deviations of these sizes.
  double log_bayes_factor = std::numeric_limits<double>::infinity();
};

// Returns the variances of a group's components that are most likely by the images and the expectations. fit: of an
// adjustment under the variances of `group`, which must have converged; variance_factor: that of its images.
//
// The marginal likelihood is that of the linearised adjustment (type-II maximum likelihood; REML). With A the
// information of the images over the variance factor, p the deviations, Q their precision and Q_0 that under the
// variances of `group`, its log is up to a constant
//   (log |Q| - log |A + Q| + b^T (A + Q)^-1 b) / 2,   b = A p + Q_0 p / variance_factor.
VarianceEstimate EstimateVariances(const PriorGroup& group, const PriorFit& fit, double variance_factor,
                                   const std::vector<ExpectedStddev>& expected);
// Does the same for deviations whose likelihood is known; the variances of `group` do not matter.
VarianceEstimate EstimateVariances(const PriorGroup& group, const DeviationLikelihood& likelihood,
                                   const std::vector<ExpectedStddev>& expected);

}  // namespace lazyloc

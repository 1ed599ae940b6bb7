#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/frame.h"

namespace lazyloc {

// What an adjustment says of the deviations p of a prior group's frames.
struct PriorFit {
  Eigen::Matrix<double, Eigen::Dynamic, 6> deviations;  // p, by frame of the group
  Eigen::MatrixXd spread;  // covariance of p by the adjustment: between two frames, the sum over the six coordinates
  // Covariance of cam_from_world that unit variance of a component causes, by component and image. Zero for database
  // images.
  std::vector<std::vector<Eigen::Matrix<double, 6, 6>>> image_parts;
};

// Returns the inverse covariance of the deviations of a group's frames.
Eigen::MatrixXd PriorPrecision(const PriorGroup& group);

// What is expected of a component's variance before the adjustment.
struct ExpectedVariance {
  double variance = 1;
  double weight = 1;  // number of deviations of this variance that the expectation counts as
};

// Returns the variances of a group's components by one step towards the maximum of their marginal likelihood: with
// C_j the shapes, Q the precision, T the spread and v the variance factor of the images,
//   variance_j <- variance_j * tr(p^T Q C_j Q p) / tr((6 Q - v Q T Q) C_j)
// (the fixed point of MacKay 1992, Bayesian interpolation, for several components), with the deviations that are
// expected added to both sums.
std::vector<double> EstimateVariances(const PriorGroup& group, const PriorFit& fit, double variance_factor,
                                      const std::vector<ExpectedVariance>& expected);

}  // namespace lazyloc

#include "colmap_lazyloc/refinement/prior_fit.h"

#include <algorithm>

#include <Eigen/Cholesky>

namespace lazyloc {

Eigen::MatrixXd PriorPrecision(const PriorGroup& group) {
  const auto size = static_cast<Eigen::Index>(group.frames.size());
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(size, size);
  for (const VarianceComponent& component : group.components) covariance += component.variance * component.shape;
  return covariance.llt().solve(Eigen::MatrixXd::Identity(size, size));
}

std::vector<double> EstimateVariances(const PriorGroup& group, const PriorFit& fit, double variance_factor,
                                      const std::vector<ExpectedVariance>& expected) {
  const Eigen::MatrixXd precision = PriorPrecision(group);
  const Eigen::MatrixXd weighted = precision * fit.deviations;
  const Eigen::MatrixXd unexplained = 6 * precision - variance_factor * precision * fit.spread * precision;
  std::vector<double> variances;
  for (size_t j = 0; j < group.components.size(); ++j) {
    const auto& [shape, variance] = group.components[j];
    const double shown = variance * weighted.cwiseProduct(shape * weighted).sum();
    const double num_shown = variance * unexplained.cwiseProduct(shape).sum();
    const auto [expected_variance, weight] = expected[j];
    variances.push_back((variance * shown + weight * expected_variance) / (std::max(num_shown, 0.0) + weight));
  }
  return variances;
}

}  // namespace lazyloc

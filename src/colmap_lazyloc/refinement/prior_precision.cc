#include "colmap_lazyloc/refinement/prior_precision.h"

#include <Eigen/Cholesky>

namespace lazyloc {

Eigen::MatrixXd ComputePriorCovariance(const PriorGroup& group, PosePart part) {
  const auto size = static_cast<Eigen::Index>(group.frames.size());
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(size, size);
  for (const VarianceComponent& component : group.components) {
    if (component.Moves(part)) covariance += component.variance * component.shape;
  }
  return covariance;
}

Eigen::MatrixXd ComputePriorPrecision(const PriorGroup& group, PosePart part) {
  const Eigen::MatrixXd covariance = ComputePriorCovariance(group, part);
  return covariance.llt().solve(Eigen::MatrixXd::Identity(covariance.rows(), covariance.cols()));
}

PriorPrecision ComputePriorPrecision(const PriorGroup& group) {
  return {ComputePriorPrecision(group, PosePart::ROTATION), ComputePriorPrecision(group, PosePart::POSITION)};
}

std::vector<Eigen::MatrixXd> ComponentCovariances(const PriorGroup& group, const PriorPrecision& precision,
                                                  const Eigen::MatrixXd& by_deviations) {
  const Eigen::Index size = precision.rotation.rows(), num_values = by_deviations.cols();
  std::vector<Eigen::MatrixXd> covariances(group.components.size(), Eigen::MatrixXd::Zero(num_values, num_values));
  for (Eigen::Index coordinate = 0; coordinate < 6; ++coordinate) {
    const Eigen::MatrixXd weighted = precision.Of(coordinate) * by_deviations.middleRows(coordinate * size, size);
    for (size_t j = 0; j < covariances.size(); ++j) {
      const VarianceComponent& component = group.components[j];
      if (!component.Moves(PriorPrecision::PartOf(coordinate))) continue;
      covariances[j] += weighted.transpose() * (component.shape * weighted);
    }
  }
  return covariances;
}

}  // namespace lazyloc

#include "colmap_lazyloc/refinement/prior_fit.h"

#include <algorithm>

namespace lazyloc {
namespace {

constexpr double kNumExpectedParameters = 1;

}  // namespace

double PriorFit::VarianceFactor(double image_variance_factor) const {
  const double shown = squared_deviation - image_variance_factor * (trace - squared_trace);
  return std::max(shown + kNumExpectedParameters, 0.0) /
         (num_parameters - 2 * trace + squared_trace + kNumExpectedParameters);
}

PriorFit FitPriors(const std::vector<PriorDeviation>& deviations, const Eigen::MatrixXd& inverse, int camera_size,
                   std::vector<Eigen::MatrixXd>* prior_parts) {
  PriorFit fit;
  const auto num_rows = static_cast<Eigen::Index>(6 * deviations.size());
  fit.num_parameters = static_cast<double>(num_rows);
  Eigen::MatrixXd with_cameras(num_rows, inverse.cols());  // covariance between u and all cameras
  Eigen::MatrixXd with_others(num_rows, num_rows);         // W
  for (size_t i = 0; i < deviations.size(); ++i) {
    const auto& [camera, residual] = deviations[i];
    with_cameras.middleRows<6>(6 * i) = residual.jacobian * inverse.middleRows<6>(camera_size * camera);
    fit.squared_deviation += residual.error.squaredNorm();
  }
  for (size_t i = 0; i < deviations.size(); ++i) {
    const auto& [camera, residual] = deviations[i];
    with_others.middleCols<6>(6 * i) = with_cameras.middleCols<6>(camera_size * camera) * residual.jacobian.transpose();
  }
  fit.trace = with_others.trace();
  fit.squared_trace = with_others.squaredNorm();
  for (Eigen::Index at = 0; at < inverse.cols(); at += camera_size) {
    const auto columns = with_cameras.middleCols(at, camera_size);
    prior_parts->push_back(columns.transpose() * columns);
  }
  return fit;
}

}  // namespace lazyloc

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

PriorFit FitPriors(const std::vector<PriorDeviation>& deviations, const Eigen::MatrixXd& inverse, int frame_size,
                   std::vector<Eigen::MatrixXd>* prior_parts) {
  PriorFit fit;
  const auto num_rows = static_cast<Eigen::Index>(6 * deviations.size());
  fit.num_parameters = static_cast<double>(num_rows);
  Eigen::MatrixXd with_frames(num_rows, inverse.cols());  // covariance between u and all frames
  Eigen::MatrixXd with_others(num_rows, num_rows);        // W
  for (size_t i = 0; i < deviations.size(); ++i) {
    const auto& [frame, residual] = deviations[i];
    with_frames.middleRows<6>(6 * i) = residual.jacobian * inverse.middleRows<6>(frame_size * frame);
    fit.squared_deviation += residual.error.squaredNorm();
  }
  for (size_t i = 0; i < deviations.size(); ++i) {
    const auto& [frame, residual] = deviations[i];
    with_others.middleCols<6>(6 * i) = with_frames.middleCols<6>(frame_size * frame) * residual.jacobian.transpose();
  }
  fit.trace = with_others.trace();
  fit.squared_trace = with_others.squaredNorm();
  for (Eigen::Index at = 0; at < inverse.cols(); at += frame_size) {
    const auto columns = with_frames.middleCols(at, frame_size);
    prior_parts->push_back(columns.transpose() * columns);
  }
  return fit;
}

}  // namespace lazyloc

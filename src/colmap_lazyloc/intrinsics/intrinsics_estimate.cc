#include "colmap_lazyloc/intrinsics/intrinsics_estimate.h"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

namespace lazyloc {

IntrinsicsScore::Matrix ScoreCovariance(const Refined& refined, int frame) {
  const IntrinsicsScore& score = refined.adjustment.intrinsics_scores[frame];
  IntrinsicsScore::Matrix covariance = refined.variance_factor * score.information + score.shared_errors;
  for (const auto& [group, component, variance] : refined.missing_variances) {
    covariance += variance * score.component_covariances[group][component];
  }
  return kCommonErrorFactor * covariance;
}

IntrinsicsEstimate EstimateIntrinsics(const IntrinsicsScore& score, const IntrinsicsScore::Matrix& score_covariance) {
  IntrinsicsEstimate estimate;
  const IntrinsicsScore::Matrix inverse = score.information.inverse();
  estimate.corrections = inverse * score.score;
  estimate.sigmas = estimate.corrections.cwiseAbs().cwiseQuotient(
      (inverse * score_covariance * inverse).diagonal().cwiseMax(1e-30).cwiseSqrt());
  const double information = std::max(score.information(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR), 1e-30);
  estimate.log_focal_factor = score.score[LOG_FOCAL_FACTOR] / information;
  estimate.log_focal_stddev = std::sqrt(score_covariance(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR)) / information;
  return estimate;
}

}  // namespace lazyloc

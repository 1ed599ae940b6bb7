#include "colmap_lazyloc/pipeline/intrinsics_estimate.h"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

namespace lazyloc {
namespace {

// Number of points of an image with independent errors, and the minimum factor on variances.
constexpr double kNumIndependentPoints = 100;
constexpr double kMinSharedErrorFactor = 4;

}  // namespace

double SharedErrorFactor(const Refined& refined, int frame) {
  const BundleAdjustmentResult& adjustment = refined.adjustment;
  const auto num_points = std::count_if(adjustment.tracks.begin(), adjustment.tracks.end(), [&](const Track& track) {
    return adjustment.posed.images[track.observations.front().image].frame == frame;
  });
  return std::max(static_cast<double>(num_points) / kNumIndependentPoints, kMinSharedErrorFactor);
}

IntrinsicsScore::Matrix ScoreCovariance(const Refined& refined, int frame) {
  const IntrinsicsScore& score = refined.adjustment.intrinsics_scores[frame];
  IntrinsicsScore::Matrix covariance = refined.variance_factor * score.information;
  for (const auto& [group, component, variance] : refined.missing_variances) {
    covariance += variance * score.prior_parts[group][component];
  }
  return SharedErrorFactor(refined, frame) * covariance;
}

IntrinsicsEstimate EstimateIntrinsics(const IntrinsicsScore& score, const IntrinsicsScore::Matrix& score_covariance,
                                      bool is_calibrated) {
  IntrinsicsEstimate estimate;
  const IntrinsicsScore::Matrix inverse = score.information.inverse();
  estimate.joint = inverse * score.score;
  estimate.joint_sigmas = estimate.joint.cwiseAbs().cwiseQuotient(
      (inverse * score_covariance * inverse).diagonal().cwiseMax(1e-30).cwiseSqrt());
  estimate.sigmas = score.score.cwiseAbs().cwiseQuotient(score_covariance.diagonal().cwiseMax(1e-30).cwiseSqrt());
  const double information = std::max(score.information(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR), 1e-30);
  estimate.log_focal_factor = score.score[LOG_FOCAL_FACTOR] / information;
  estimate.log_focal_stddev = std::sqrt(score_covariance(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR)) / information;
  if (!is_calibrated) return estimate;
  // Takes significant other corrections for errors that no parameter describes, as of rolling shutters, because these
  // pretend another focal length as well.
  const Eigen::Matrix<double, kNumOthers, 1> others = estimate.joint.tail<kNumOthers>();
  const Eigen::Matrix<double, kNumOthers, kNumOthers> covariance =
      (inverse * score_covariance * inverse).bottomRightCorner<kNumOthers, kNumOthers>();
  const double misfit = others.dot(covariance.inverse() * others) / kNumOthers;
  estimate.log_focal_stddev *= std::sqrt(std::max(1.0, misfit));
  return estimate;
}

}  // namespace lazyloc

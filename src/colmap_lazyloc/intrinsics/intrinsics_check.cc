#include "colmap_lazyloc/intrinsics/intrinsics_check.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/LU>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/intrinsics/focal_length.h"
#include "colmap_lazyloc/intrinsics/intrinsics_judgement.h"
#include "colmap_lazyloc/noise/viewpoint_errors.h"

namespace lazyloc {
namespace {

using PoseDerivatives = Eigen::Matrix<double, 6, NUM_INTRINSICS_PARAMETERS>;

// Standard deviations of what nobody has calibrated: the shift of the principal point and the radial displacement of
// the image's corners, over half the diagonal, and the log of the pixels' aspect ratio. All are times
// kSharedCameraFactor for a camera of the database that the photo shares, because it is probably the very one.
constexpr double kUncalibratedShift = 0.02;
constexpr double kUncalibratedDistortion = 0.005;
constexpr double kUncalibratedAspect = 0.003;
constexpr double kSharedCameraFactor = 0.25;

// Returns the covariance of a query frame's score, with the variances that the adjustment shows and the errors that
// images share.
IntrinsicsScore::Matrix ScoreCovariance(const Refined& refined, const IntrinsicsScore& score) {
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

// Returns the expected squares and products of the corrections but the focal length's of a camera whose
// intrinsics nobody has measured: by their usual sizes and the score. Zero for measured intrinsics.
IntrinsicsScore::Matrix UncalibratedCovariance(const IntrinsicsScore& score,
                                               const IntrinsicsScore::Matrix& score_covariance, const Camera& camera,
                                               IntrinsicsOrigin origin) {
  IntrinsicsScore::Matrix covariance = IntrinsicsScore::Matrix::Zero();
  if (IsCalibrated(origin)) return covariance;
  constexpr int kNumOthers = NUM_INTRINSICS_PARAMETERS - 1;  // corrections but the first, the focal length's
  using Matrix = Eigen::Matrix<double, kNumOthers, kNumOthers>;
  const double radius = HalfDiagonalPx(camera);
  const double shift = kUncalibratedShift * radius;
  const double radial = kUncalibratedDistortion * radius / std::pow(radius / kRadialUnitPx, 3);
  const Eigen::Matrix<double, kNumOthers, 1> stddevs =
      (origin == IntrinsicsOrigin::SHARED ? kSharedCameraFactor : 1) *
      Eigen::Matrix<double, kNumOthers, 1>(shift, shift, kUncalibratedAspect, radial);
  const Matrix expected = stddevs.cwiseAbs2().asDiagonal();
  const Matrix inverse = score.information.bottomRightCorner<kNumOthers, kNumOthers>().inverse();
  const Matrix variance = inverse * score_covariance.bottomRightCorner<kNumOthers, kNumOthers>() * inverse;
  const Matrix gain = expected * (expected + variance).inverse();
  // Takes the expected square of the corrections, not their variance, because the pose stays that of the given camera.
  const Eigen::Matrix<double, kNumOthers, 1> mean = gain * inverse * score.score.tail<kNumOthers>();
  covariance.bottomRightCorner<kNumOthers, kNumOthers>() = gain * variance + mean * mean.transpose();
  return covariance;
}

// Returns the derivatives of an image's pose around the camera by those of its frame around the layout's origin.
PoseDerivatives DerivativesAroundCamera(const PosedImages& posed, int query, const PoseDerivatives& of_frame) {
  const Eigen::Matrix3d cam_from_frame = posed.images[query].cam_from_frame.rotation.toRotationMatrix();
  PoseDerivatives of_image;
  of_image << cam_from_frame * of_frame.topRows<3>(), cam_from_frame * of_frame.bottomRows<3>();
  return AroundCamera(CamFromWorld(posed, query)) * of_image;
}

}  // namespace

CheckedIntrinsics CheckIntrinsics(const QueryGroup& group, const Layout& layout, const Refined& refined,
                                  std::vector<PoseDistribution> poses, const LocalizerOptions& options) {
  const std::optional<QueryCamera>& camera = refined.camera;
  const PosedImages& adjusted = refined.adjustment.posed;
  CheckedIntrinsics checked;
  checked.results.resize(layout.num_queries);
  checked.cameras.resize(layout.num_queries);
  checked.poses = std::move(poses);
  checked.posed = RelativeToGivenDatabase(layout, adjusted);
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    const IntrinsicsScore& score = refined.adjustment.intrinsics_scores[frame];
    const IntrinsicsScore::Matrix score_covariance = ScoreCovariance(refined, score);
    for (const int query : layout.QueriesOf(frame)) {
      const LocalizationProblem& problem = group.images[query].problem;
      IntrinsicsResult& result = checked.results[query];
      result.origin = problem.intrinsics_origin;
      if (!HasFocalLength(problem.query_camera)) continue;  // a spherical camera has no intrinsics to test
      const IntrinsicsEstimate estimate = EstimateIntrinsics(score, score_covariance);
      result.focal_factor = camera ? camera->FocalFactor() : std::exp(estimate.log_focal_factor);
      result.focal_factor_stddev = result.focal_factor * estimate.log_focal_stddev;
      if (camera) checked.cameras[query] = camera->Intrinsics();
      PoseDistribution& pose = checked.poses[query];
      const PoseDerivatives derivatives = DerivativesAroundCamera(adjusted, query, score.frame_from_correction);
      const IntrinsicsScore::Matrix others =
          UncalibratedCovariance(score, score_covariance, problem.query_camera, result.origin);
      pose.of_images += derivatives * others * derivatives.transpose();
      pose.by_log_focal = derivatives.col(LOG_FOCAL_FACTOR);
      pose.log_focal_variance = JudgeIntrinsics(problem.query_camera, estimate, camera.has_value(), options, &result);
    }
  }
  return checked;
}

}  // namespace lazyloc

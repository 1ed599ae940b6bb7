#include "colmap_lazyloc/intrinsics/intrinsics_check.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include <Eigen/LU>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/group/failure.h"
#include "colmap_lazyloc/intrinsics/focal_length.h"
#include "colmap_lazyloc/intrinsics/intrinsics_judgement.h"
#include "colmap_lazyloc/noise/viewpoint_errors.h"

namespace lazyloc {
namespace {

// Standard deviation of the log of an estimated focal length above which there is no pose, and factor below which there
// is none. Adjustment takes errors for linear in the log, and goes astray, to ever shorter focal lengths, as in photos
// of a wall that are taken from the front. A fourth of a guess is a field of view of 118 degrees.
constexpr double kMaxLogFocalStddev = 0.1;
constexpr double kMinFocalFactor = 0.25;

// Minimum number of database frames that show a focal length: two do not show the errors of their poses, which the
// focal length then explains.
constexpr size_t kMinNumFrames = 3;

// Standard deviation of the logs of the database's focal lengths above which its cameras had different lenses.
constexpr double kMaxStddevOfOneLens = 0.15;

constexpr char kTooFewFramesReason[] =
    "nobody has stated the focal length, and fewer than three database images agree with the pose: they do not show "
    "whether the focal length or a database pose is wrong";

using PoseDerivatives = Eigen::Matrix<double, 6, NUM_INTRINSICS_PARAMETERS>;

// variance_factor: of the score's covariance over its information.
IntrinsicsEstimate EstimateIntrinsics(const IntrinsicsScore& score, double variance_factor) {
  IntrinsicsEstimate estimate;
  constexpr int kSize = kNumTestedIntrinsics;
  const Eigen::Matrix<double, kSize, kSize> inverse = score.information.topLeftCorner<kSize, kSize>().inverse();
  estimate.corrections = inverse * score.score.head<kSize>();
  estimate.sigmas = estimate.corrections.cwiseAbs().cwiseQuotient((variance_factor * inverse).diagonal().cwiseSqrt());
  const double information = std::max(score.information(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR), 1e-30);
  estimate.log_focal_factor = score.score[LOG_FOCAL_FACTOR] / information;
  estimate.log_focal_stddev = std::sqrt(variance_factor / information);
  estimate.common_error_factor = score.common_error_factor;
  return estimate;
}

size_t NumDatabaseFrames(const BundleAdjustmentResult& adjustment) {
  std::set<int> frames;
  for (const Track& track : adjustment.tracks) {
    for (const TrackObservation& element : track.observations) {
      if (adjustment.posed.IsDatabase(element.image)) frames.insert(adjustment.posed.images[element.image].frame);
    }
  }
  return frames.size();
}

// Throws Failure if the images do not determine an estimated focal length.
void CheckEstimate(const BundleAdjustmentResult& adjustment, const Camera& initial, double focal_factor,
                   double log_focal_stddev) {
  if (NumDatabaseFrames(adjustment) < kMinNumFrames) {
    throw Failure{QueryStatus::UNKNOWN_CAMERA, kTooFewFramesReason};
  }
  if (log_focal_stddev > kMaxLogFocalStddev || focal_factor < kMinFocalFactor * std::min(1.0, FactorToGuess(initial))) {
    throw Failure{QueryStatus::UNKNOWN_CAMERA, kUnknownFocalLengthReason};
  }
}

// Returns the variance of the mean of the logs of the database images' focal lengths, if no two are the same. Then
// each was estimated from one image, and the pose of the image has the same error. An estimate that relies on these
// poses errs with their mean. Zero if the cameras had different lenses.
double VarianceByDatabase(const std::vector<ImagePair>& pairs) {
  std::set<double> logs;
  for (const ImagePair& pair : pairs) logs.insert(std::log(MeanFocalLength(pair.other_camera)));
  const double num = static_cast<double>(logs.size());
  if (logs.size() < std::max<size_t>(pairs.size(), 2)) return 0;
  const double mean = std::accumulate(logs.begin(), logs.end(), 0.0) / num;
  double sum_of_squares = 0;
  for (const double log : logs) sum_of_squares += std::pow(log - mean, 2);
  const double variance = sum_of_squares / (num - 1);
  return variance < std::pow(kMaxStddevOfOneLens, 2) ? variance / num : 0;
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
  checked.information.resize(layout.num_queries);
  checked.poses = std::move(poses);
  checked.posed = RelativeToGivenDatabase(layout, adjusted);
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    const IntrinsicsScore& score = refined.adjustment.intrinsics_scores[frame];
    // Not zero, if the data are exact.
    const double variance_factor = std::max(score.common_error_factor * refined.variance_factor, 1e-30);
    for (const int query : layout.QueriesOf(frame)) {
      const LocalizationProblem& problem = group.images[query].problem;
      IntrinsicsResult& result = checked.results[query];
      result.origin = problem.intrinsics_origin;
      if (!HasFocalLength(problem.query_camera)) continue;  // a spherical camera has no intrinsics to test
      const IntrinsicsEstimate estimate = EstimateIntrinsics(score, variance_factor);
      result.focal_factor = camera ? camera->FocalFactor() : std::exp(estimate.log_focal_factor);
      if (camera) checked.cameras[query] = camera->Intrinsics();
      checked.information[query] = InformationOf(score, variance_factor);
      PoseDistribution& pose = checked.poses[query];
      const PoseDerivatives derivatives = DerivativesAroundCamera(adjusted, query, score.frame_from_correction);
      // Takes the expected square of the corrections that are left, because the pose is that of those that were made.
      const OtherCorrections made = camera ? camera->Corrections() : OtherCorrections::Zero();
      const auto [mean, covariance] =
          UncalibratedCorrections(score, variance_factor, made, problem.query_camera, result.origin);
      const OtherCovariance mean_square = covariance + (mean - made) * (mean - made).transpose();
      const auto by_others = derivatives.rightCols<kNumOtherCorrections>();
      pose.of_images += by_others * mean_square * by_others.transpose();
      if (result.origin == IntrinsicsOrigin::JOINT && !camera) {
        checked.cameras[query] = problem.query_camera;
        result.covariance = problem.intrinsics_covariance;
        pose.of_images += derivatives * result.covariance * derivatives.transpose();
      }
      // An estimated focal length moves with them.
      const auto log_focal_by_others = score.log_factor_from_correction.tail<kNumOtherCorrections>();
      const double log_focal_stddev = std::sqrt(std::pow(estimate.log_focal_stddev, 2) +
                                                log_focal_by_others.dot(mean_square * log_focal_by_others));
      if (camera) CheckEstimate(refined.adjustment, problem.query_camera, result.focal_factor, log_focal_stddev);
      const double missing_variance = camera ? VarianceByDatabase(problem.pairs) + refined.log_focal_scatter : 0;
      result.focal_factor_stddev = result.focal_factor * std::hypot(log_focal_stddev, std::sqrt(missing_variance));
      pose.by_log_focal = derivatives.col(LOG_FOCAL_FACTOR);
      pose.log_focal_variance = JudgeIntrinsics(problem.query_camera, estimate, camera.has_value(), options, &result);
      pose.log_focal_variance += missing_variance;
    }
  }
  return checked;
}

}  // namespace lazyloc

#include "colmap_lazyloc/intrinsics/intrinsics_check.h"

#include <cmath>
#include <utility>

#include "colmap_lazyloc/group/failure.h"
#include "colmap_lazyloc/intrinsics/focal_length.h"
#include "colmap_lazyloc/intrinsics/intrinsics_estimate.h"
#include "colmap_lazyloc/intrinsics/intrinsics_judgement.h"
#include "colmap_lazyloc/intrinsics/uncalibrated_camera.h"
#include "colmap_lazyloc/noise/viewpoint_errors.h"

namespace lazyloc {
namespace {

using PoseDerivatives = Eigen::Matrix<double, 6, NUM_INTRINSICS_PARAMETERS>;

// Returns the derivatives of an image's pose around the camera by those of its frame around the layout's origin.
PoseDerivatives DerivativesAroundCamera(const PosedImages& posed, int query, const PoseDerivatives& of_frame) {
  const Eigen::Matrix3d cam_from_frame = posed.images[query].cam_from_frame.rotation.toRotationMatrix();
  PoseDerivatives of_image;
  of_image << cam_from_frame * of_frame.topRows<3>(), cam_from_frame * of_frame.bottomRows<3>();
  return AroundCamera(CamFromWorld(posed, query)) * of_image;
}

// Sets the verdict. Returns the expected square of the error of the log focal length that the covariance lacks.
double Judge(const Camera& camera, const IntrinsicsEstimate& estimate, bool is_refined, const LocalizerOptions& options,
             IntrinsicsResult* result) {
  if (is_refined) {
    JudgeRefined(camera, estimate, result);
    // Returns what the adjustment does not know of the estimate's error.
    return (1 - 1 / kCommonErrorFactor) * std::pow(estimate.log_focal_stddev, 2);
  }
  const FocalLengthJudgement judgement =
      JudgeFocalLength(estimate.log_focal_factor, estimate.log_focal_stddev, result->origin, options);
  JudgeGiven(camera, estimate, judgement, result);
  return judgement.mean_square;
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
  checked.posed = AsReported(layout, adjusted);
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    const IntrinsicsScore& score = refined.adjustment.intrinsics_scores[frame];
    const IntrinsicsScore::Matrix score_covariance = ScoreCovariance(refined, frame);
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
      pose.log_focal_variance = Judge(problem.query_camera, estimate, camera.has_value(), options, &result);
    }
  }
  return checked;
}

}  // namespace lazyloc

#include "colmap_lazyloc/intrinsics/intrinsics_check.h"

#include <cmath>
#include <utility>

#include "colmap_lazyloc/group/failure.h"
#include "colmap_lazyloc/intrinsics/intrinsics_estimate.h"
#include "colmap_lazyloc/intrinsics/intrinsics_judgement.h"
#include "colmap_lazyloc/intrinsics/uncalibrated_camera.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/noise/viewpoint_errors.h"
#include "colmap_lazyloc/refinement/covariance.h"

namespace lazyloc {
namespace {

using PoseDerivatives = Eigen::Matrix<double, 6, NUM_INTRINSICS_PARAMETERS>;

// Returns the derivatives of an image's pose in the world by those of its frame around the layout's origin.
PoseDerivatives DerivativesInWorld(const Layout& layout, const PosedImages& posed, int query,
                                   const PoseDerivatives& of_frame) {
  const Eigen::Matrix3d cam_from_frame = posed.images[query].cam_from_frame.rotation.toRotationMatrix();
  PoseDerivatives of_image;
  of_image << cam_from_frame * of_frame.topRows<3>(), cam_from_frame * of_frame.bottomRows<3>();
  return TangentFromAround(layout.origin, CamFromWorld(posed, query).rotation) * of_image;
}

// Adds to the uncertainty of a pose.
void AddCovariance(const Eigen::Matrix<double, 6, 6>& covariance, const Rigid3d& cam_from_world,
                   PoseUncertainty* uncertainty) {
  const Eigen::Matrix<double, 6, 6> sum = uncertainty->covariance + covariance;
  uncertainty->covariance = (sum + sum.transpose()) / 2;
  // Moves the origin to the camera, because the position's part would be lost in large coordinates.
  const Eigen::Matrix<double, 6, 6> around_camera =
      CovarianceFromAround(-CamInWorld(cam_from_world), cam_from_world.rotation, uncertainty->covariance);
  uncertainty->spread = ComputePoseSpread({cam_from_world.rotation, Eigen::Vector3d::Zero()}, around_camera);
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
                                  std::vector<PoseUncertainty> uncertainties, const LocalizerOptions& options,
                                  const QueryCamera* camera) {
  const PosedImages& adjusted = refined.adjustment.posed;
  CheckedIntrinsics checked;
  checked.results.resize(layout.num_queries);
  checked.focal_errors.resize(layout.num_queries);
  checked.cameras.resize(layout.num_queries);
  checked.uncertainties = std::move(uncertainties);
  checked.posed = AsReported(layout, adjusted);
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    const IntrinsicsScore& score = refined.adjustment.intrinsics_scores[frame];
    const IntrinsicsScore::Matrix score_covariance = ScoreCovariance(refined, frame);
    for (const int query : layout.QueriesOf(frame)) {
      const LocalizationProblem& problem = group.images[query].problem;
      IntrinsicsResult& result = checked.results[query];
      result.origin = problem.intrinsics_origin;
      const IntrinsicsEstimate estimate = EstimateIntrinsics(score, score_covariance);
      result.focal_factor = camera != nullptr ? camera->FocalFactor() : std::exp(estimate.log_focal_factor);
      result.focal_factor_stddev = result.focal_factor * estimate.log_focal_stddev;

      const PoseDerivatives derivatives = DerivativesInWorld(layout, adjusted, query, score.frame_from_correction);
      const Rigid3d pose = PoseInWorld(layout, adjusted, query);
      if (camera != nullptr) checked.cameras[query] = camera->Intrinsics();
      PoseUncertainty& uncertainty = checked.uncertainties[query];
      const IntrinsicsScore::Matrix others =
          UncalibratedCovariance(score, score_covariance, problem.query_camera, result.origin);
      AddCovariance(derivatives * others * derivatives.transpose(), pose, &uncertainty);

      const double mean_square = Judge(problem.query_camera, estimate, camera != nullptr, options, &result);
      checked.focal_errors[query] = {mean_square, derivatives.col(LOG_FOCAL_FACTOR)};
      AddFocalLengthUncertainty(checked.focal_errors[query], pose, &uncertainty);
    }
  }
  return checked;
}

void AddFocalLengthUncertainty(const FocalLengthError& error, const Rigid3d& cam_from_world,
                               PoseUncertainty* uncertainty) {
  const Eigen::Matrix<double, 6, 1>& derivative = error.pose_from_log_focal;
  AddCovariance(error.mean_square * derivative * derivative.transpose(), cam_from_world, uncertainty);
}

}  // namespace lazyloc

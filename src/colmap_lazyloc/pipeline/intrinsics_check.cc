#include "colmap_lazyloc/pipeline/intrinsics_check.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include <Eigen/LU>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/database_priors.h"
#include "colmap_lazyloc/pipeline/failure.h"
#include "colmap_lazyloc/refinement/covariance.h"

namespace lazyloc {
namespace {

// Standard deviation of the log of a wrong focal length: EXIF is off by 2 to 50 %.
constexpr double kWrongStddev = 0.2;
// Minimum deviation of a right value in the judgement: adjustment is only exact to first order.
constexpr double kMinRightStddev = 0.001;
// Probability that a value is wrong before the images are asked.
constexpr double kWrongGivenProbability = 0.02;
constexpr double kWrongSharedProbability = 0.1;
constexpr double kWrongExifProbability = 0.5;
// Factor on the standard deviations of the score, because rolling shutters and errors that all images share are not in
// them: with right intrinsics, deviations are up to twice as large.
constexpr double kSharedErrorFactor = 2;
// Standard deviation of the log focal length above which the images cannot tell whether a value is right.
constexpr double kMaxObservableStddev = 0.02;
// Significance, and displacement of image points (as a fraction of the focal length, and at least in pixels), from
// which on principal point or distortion count as contradicted. Smaller errors hardly move a pose.
constexpr double kMinOtherSigma = 5;
constexpr double kMinPrincipalPointShift = 0.02;
constexpr double kMinDistortionPx = 2;

double NormalDensity(double x, double variance) { return std::exp(-0.5 * x * x / variance) / std::sqrt(variance); }

// Returns the expected square of a deviation with a normal prior.
double MeanSquare(double prior_stddev, double measured, double variance) {
  const double prior_variance = prior_stddev * prior_stddev;
  const double gain = prior_variance / (prior_variance + variance);
  return gain * gain * measured * measured + gain * variance;
}

std::string Number(double value, int num_digits) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.*f", num_digits, value);
  return text;
}

// Estimates of all corrections together, and of each alone.
struct Corrections {
  IntrinsicsScore::Vector joint, joint_sigmas;  // in their units; over their standard deviations
  IntrinsicsScore::Vector sigmas;               // of each correction alone over its standard deviation
  double log_focal_factor = 0, log_focal_stddev = 0;
};

// Returns the covariance of a score, with the variances that the adjustment shows.
IntrinsicsScore::Matrix ScoreCovariance(const IntrinsicsScore& score, const BundleAdjustmentResult& adjustment,
                                        double image_factor) {
  IntrinsicsScore::Matrix covariance = image_factor * score.information;
  for (size_t i = 0; i < adjustment.prior_fits.size(); ++i) {
    const PriorGroup& group = adjustment.posed.prior_groups[i];
    const std::vector<double> variances = VariancesForCovariance(group, adjustment.prior_fits[i], image_factor);
    for (size_t j = 0; j < variances.size(); ++j) {
      covariance += (variances[j] - image_factor * group.components[j].variance) * score.prior_parts[i][j];
    }
  }
  return covariance;
}

Corrections Estimate(const IntrinsicsScore& score, const BundleAdjustmentResult& adjustment, double image_factor) {
  Corrections corrections;
  const IntrinsicsScore::Matrix noise =
      kSharedErrorFactor * kSharedErrorFactor * ScoreCovariance(score, adjustment, image_factor);
  const IntrinsicsScore::Matrix inverse = score.information.inverse();
  corrections.joint = inverse * score.score;
  corrections.joint_sigmas =
      corrections.joint.cwiseAbs().cwiseQuotient((inverse * noise * inverse).diagonal().cwiseMax(1e-30).cwiseSqrt());
  corrections.sigmas = score.score.cwiseAbs().cwiseQuotient(noise.diagonal().cwiseMax(1e-30).cwiseSqrt());
  const double information = std::max(score.information(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR), 1e-30);
  corrections.log_focal_factor = score.score[LOG_FOCAL_FACTOR] / information;
  corrections.log_focal_stddev = std::sqrt(noise(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR)) / information;
  return corrections;
}

// Returns what is wrong with principal point or distortion; empty if nothing is, or the focal length explains more.
std::string OtherContradiction(const Camera& camera, const Corrections& corrections, bool is_focal_length_wrong) {
  const Eigen::Vector2d size(static_cast<double>(camera.width), static_cast<double>(camera.height));
  const auto explains_more = [&](int parameter) {
    return !is_focal_length_wrong || corrections.sigmas[parameter] > corrections.sigmas[LOG_FOCAL_FACTOR];
  };
  const double radius = size.norm() / 2;
  const double corner_px = corrections.joint[RADIAL_DISTORTION] * std::pow(radius / kRadialUnitPx, 3);
  if (corrections.joint_sigmas[RADIAL_DISTORTION] > kMinOtherSigma && std::abs(corner_px) > kMinDistortionPx &&
      explains_more(RADIAL_DISTORTION)) {
    return "the images contradict the given distortion: they ask for a radial displacement of the image's corners by " +
           Number(corner_px, 1) + " px";
  }
  const Eigen::Vector2d shift(corrections.joint[PRINCIPAL_POINT_X], corrections.joint[PRINCIPAL_POINT_Y]);
  const int axis = std::abs(shift.x()) > std::abs(shift.y()) ? PRINCIPAL_POINT_X : PRINCIPAL_POINT_Y;
  if (corrections.joint_sigmas[axis] > kMinOtherSigma &&
      shift.norm() > kMinPrincipalPointShift * MeanFocalLength(camera) && explains_more(axis)) {
    const Eigen::Vector2d given = PrincipalPoint(camera), asked = given + shift;
    return "the images contradict the given principal point (" + Number(given.x(), 1) + ", " + Number(given.y(), 1) +
           "): they ask for (" + Number(asked.x(), 1) + ", " + Number(asked.y(), 1) + ")";
  }
  return "";
}

// Returns the tangent of a pose around the world's origin by that around another origin: t = t_origin - R origin.
Eigen::Matrix<double, 6, 6> MoveOrigin(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& origin) {
  Eigen::Matrix<double, 6, 6> moved = Eigen::Matrix<double, 6, 6>::Identity();
  moved.bottomLeftCorner<3, 3>() = Hat(rotation * origin);
  return moved;
}

// Returns the derivative of an image's pose in the world by that of its frame around the layout's origin.
Eigen::Matrix<double, 6, 1> PoseDerivative(const Layout& layout, const PosedImages& posed, int query,
                                           const Eigen::Matrix<double, 6, 1>& of_frame) {
  const Eigen::Matrix3d cam_from_frame = posed.images[query].cam_from_frame.rotation.toRotationMatrix();
  Eigen::Matrix<double, 6, 1> of_image;
  of_image << cam_from_frame * of_frame.head<3>(), cam_from_frame * of_frame.tail<3>();
  return MoveOrigin(CamFromWorld(posed, query).rotation, layout.origin) * of_image;
}

}  // namespace

FocalLengthJudgement JudgeFocalLength(double log_factor, double stddev, IntrinsicsOrigin origin,
                                      const LocalizerOptions& options) {
  const double right_stddev = std::max(options.focal_length_stddev_ratio, kMinRightStddev);
  const double variance = stddev * stddev;
  const double prior = origin == IntrinsicsOrigin::GUESS    ? 1
                       : origin == IntrinsicsOrigin::EXIF   ? kWrongExifProbability
                       : origin == IntrinsicsOrigin::SHARED ? kWrongSharedProbability
                                                            : kWrongGivenProbability;
  const double right = (1 - prior) * NormalDensity(log_factor, right_stddev * right_stddev + variance);
  const double wrong = prior * NormalDensity(log_factor, kWrongStddev * kWrongStddev + variance);
  FocalLengthJudgement judgement;
  judgement.wrong_probability = wrong + right > 0 ? wrong / (wrong + right) : 1;
  judgement.mean_square = judgement.wrong_probability * MeanSquare(kWrongStddev, log_factor, variance) +
                          (1 - judgement.wrong_probability) * MeanSquare(right_stddev, log_factor, variance);
  if (options.focal_length_stddev_ratio == 0 && origin == IntrinsicsOrigin::GIVEN) judgement.mean_square = 0;
  return judgement;
}

void AddFocalLengthUncertainty(double mean_square, const Rigid3d& cam_from_world, IntrinsicsResult* intrinsics,
                               PoseUncertainty* uncertainty) {
  const Eigen::Matrix<double, 6, 1>& derivative = intrinsics->pose_from_log_focal;
  uncertainty->covariance += mean_square * derivative * derivative.transpose();
  intrinsics->mean_square += mean_square;
  // Moves the origin to the camera, because the position's part would be lost in large coordinates.
  const Eigen::Matrix<double, 6, 6> local_from_world = MoveOrigin(cam_from_world.rotation, -CamInWorld(cam_from_world));
  const Eigen::Matrix<double, 6, 6> local = local_from_world * uncertainty->covariance * local_from_world.transpose();
  uncertainty->spread =
      ComputePoseSpread({cam_from_world.rotation, Eigen::Vector3d::Zero()}, (local + local.transpose()) / 2);
}

std::string FocalLengthContradiction(const Camera& camera, double factor, double factor_stddev) {
  const double given_px = MeanFocalLength(camera);
  return "the images contradict the given focal length of " + Number(given_px, 1) + " px: they ask for " +
         Number(factor * given_px, 1) + " +- " + Number(factor_stddev * given_px, 1) + " px";
}

std::vector<IntrinsicsResult> CheckIntrinsics(const QueryGroup& group, const Layout& layout, const Refined& refined,
                                              const LocalizerOptions& options,
                                              std::vector<PoseUncertainty>* uncertainties, const QueryCamera* camera) {
  const BundleAdjustmentResult& adjustment = refined.adjustment;
  const double factor =
      VarianceFactor(adjustment.posed, adjustment.tracks, RobustLoss(options.bundle_adjustment.loss_scale_sigma));
  std::vector<IntrinsicsResult> results;
  for (int query = 0; query < layout.num_queries; ++query) {
    const LocalizationProblem& problem = group.images[query].problem;
    const IntrinsicsScore& score = adjustment.intrinsics_scores[layout.FrameOf(query)];
    const Corrections corrections = Estimate(score, adjustment, factor);
    IntrinsicsResult result;
    result.origin = problem.intrinsics_origin;
    result.focal_factor = camera != nullptr ? camera->FocalFactor() : std::exp(corrections.log_focal_factor);
    result.focal_factor_stddev = result.focal_factor * corrections.log_focal_stddev;
    if (camera != nullptr) {
      result.verdict = IntrinsicsVerdict::REFINED;
      result.contradiction = OtherContradiction(problem.query_camera, corrections, /*is_focal_length_wrong=*/false);
      results.push_back(result);
      continue;
    }
    const FocalLengthJudgement judgement =
        JudgeFocalLength(corrections.log_focal_factor, corrections.log_focal_stddev, result.origin, options);
    const bool is_wrong = judgement.wrong_probability > 0.5 && result.origin != IntrinsicsOrigin::GUESS &&
                          HasFocalLength(problem.query_camera);
    result.contradiction = OtherContradiction(problem.query_camera, corrections, is_wrong);
    if (result.contradiction.empty() && is_wrong) {
      result.contradiction =
          FocalLengthContradiction(problem.query_camera, result.focal_factor, result.focal_factor_stddev);
    }
    result.verdict = !result.contradiction.empty() ? IntrinsicsVerdict::CONTRADICTED
                     : corrections.log_focal_stddev > kMaxObservableStddev || result.origin == IntrinsicsOrigin::GUESS
                         ? IntrinsicsVerdict::UNOBSERVABLE
                         : IntrinsicsVerdict::CONFIRMED;
    result.pose_from_log_focal =
        PoseDerivative(layout, adjustment.posed, query, score.frame_from_correction.col(LOG_FOCAL_FACTOR));
    Rigid3d pose = CamFromWorld(adjustment.posed, query);
    pose.translation -= pose.rotation * layout.origin;
    AddFocalLengthUncertainty(judgement.mean_square, pose, &result, &(*uncertainties)[query]);
    results.push_back(result);
  }
  return results;
}

void RefuseContradicted(const Layout& layout, const std::vector<IntrinsicsResult>& intrinsics) {
  CheckFrames(layout.num_query_frames, QueryStatus::INCONSISTENT_INTRINSICS, [&](int frame) {
    for (const int query : layout.QueriesOf(frame)) {
      if (intrinsics[query].verdict == IntrinsicsVerdict::CONTRADICTED) return Reason(intrinsics[query].contradiction);
    }
    return Reason();
  });
}

}  // namespace lazyloc

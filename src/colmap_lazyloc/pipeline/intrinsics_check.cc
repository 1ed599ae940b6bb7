#include "colmap_lazyloc/pipeline/intrinsics_check.h"

#include <algorithm>
#include <cmath>
#include <string>

#include <Eigen/LU>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/database_priors.h"
#include "colmap_lazyloc/pipeline/failure.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

// Standard deviation of the log of a wrong focal length: EXIF is off by 2 to 50 %.
constexpr double kWrongStddev = 0.2;
// Minimum deviation of a right value in the judgement: adjustment is only exact to first order.
constexpr double kMinRightStddev = 0.001;
// Standard deviation and probability of a slightly wrong value, as of a lens that was focused anew or a photo that was
// cut. It is no reason to refuse a value, but the covariance allows for it.
constexpr double kSlightlyWrongStddev = 0.03;
constexpr double kSlightlyWrongProbability = 0.2;
// Probability that a value is wrong before the images are asked.
constexpr double kWrongGivenProbability = 0.02;
constexpr double kWrongSharedProbability = 0.1;
constexpr double kWrongExifProbability = 0.5;
// Factor on the standard deviations of the score, because rolling shutters and errors that all images share are not in
// them: with right intrinsics, deviations are up to twice as large.
constexpr double kSharedErrorFactor = 2;
// Standard deviation of the log focal length above which the images cannot tell whether a value is right.
constexpr double kMaxObservableStddev = 0.02;
// Significance, and displacement from which on principal point (as a fraction of the focal length) or distortion (at
// the image's corners, of half the diagonal) count as contradicted. Rolling shutters ask for a distortion at 5
// deviations.
constexpr double kMinOtherSigma = 5;
constexpr double kMinPrincipalPointShift = 0.02;
constexpr double kMinDistortionShift = 0.015;

// Standard deviations of what nobody has calibrated: the shift of the principal point and the radial displacement of
// the image's corners, over half the diagonal, and the log of the pixels' aspect ratio. All are times
// kSharedCameraFactor for a camera of the database that the photo shares, because it is probably the very one.
constexpr double kUncalibratedShift = 0.02;
constexpr double kUncalibratedDistortion = 0.005;
constexpr double kUncalibratedAspect = 0.003;
constexpr double kSharedCameraFactor = 0.25;
// 99 % quantile of the chi-square distribution with 4 degrees of freedom.
constexpr double kMinUncalibratedChiSquare = 13.3;

constexpr int kNumOthers = NUM_INTRINSICS_PARAMETERS - 1;  // corrections but the first, the focal length's

double NormalDensity(double x, double variance) { return std::exp(-0.5 * x * x / variance) / std::sqrt(variance); }

// Returns the expected square of a deviation with a normal prior.
double MeanSquare(double prior_stddev, double measured, double variance) {
  const double prior_variance = prior_stddev * prior_stddev;
  const double gain = prior_variance / (prior_variance + variance);
  return gain * gain * measured * measured + gain * variance;
}

double HalfDiagonal(const Camera& camera) {
  return Eigen::Vector2d(static_cast<double>(camera.width), static_cast<double>(camera.height)).norm() / 2;
}

// Estimates of all corrections together, and of each alone.
struct Corrections {
  IntrinsicsScore::Vector joint, joint_sigmas;  // in their units; over their standard deviations
  IntrinsicsScore::Vector sigmas;               // of each correction alone over its standard deviation
  double log_focal_factor = 0, log_focal_stddev = 0;
};

// Returns the covariance of a score, with the variances that the adjustment shows and the errors that images share.
IntrinsicsScore::Matrix ScoreCovariance(const IntrinsicsScore& score, const BundleAdjustmentResult& adjustment,
                                        double image_factor) {
  IntrinsicsScore::Matrix covariance = image_factor * score.information;
  ForEachMissingVariance(adjustment, image_factor, [&](size_t group, size_t component, double variance) {
    covariance += variance * score.prior_parts[group][component];
  });
  return kSharedErrorFactor * kSharedErrorFactor * covariance;
}

// noise: covariance of the score; is_calibrated: true if all but the focal length should be right.
Corrections Estimate(const IntrinsicsScore& score, const IntrinsicsScore::Matrix& noise, bool is_calibrated) {
  Corrections corrections;
  const IntrinsicsScore::Matrix inverse = score.information.inverse();
  corrections.joint = inverse * score.score;
  corrections.joint_sigmas =
      corrections.joint.cwiseAbs().cwiseQuotient((inverse * noise * inverse).diagonal().cwiseMax(1e-30).cwiseSqrt());
  corrections.sigmas = score.score.cwiseAbs().cwiseQuotient(noise.diagonal().cwiseMax(1e-30).cwiseSqrt());
  const double information = std::max(score.information(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR), 1e-30);
  corrections.log_focal_factor = score.score[LOG_FOCAL_FACTOR] / information;
  corrections.log_focal_stddev = std::sqrt(noise(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR)) / information;
  if (!is_calibrated) return corrections;
  // Takes significant other corrections for errors that no parameter describes, as of rolling shutters, because these
  // pretend another focal length as well.
  const Eigen::Matrix<double, kNumOthers, 1> others = corrections.joint.tail<kNumOthers>();
  const Eigen::Matrix<double, kNumOthers, kNumOthers> covariance =
      (inverse * noise * inverse).bottomRightCorner<kNumOthers, kNumOthers>();
  const double misfit = others.dot(covariance.inverse() * others) / kNumOthers;
  corrections.log_focal_stddev *= std::sqrt(std::max(1.0, misfit));
  return corrections;
}

// Mean and covariance of the corrections.
struct CorrectionEstimate {
  IntrinsicsScore::Vector mean = IntrinsicsScore::Vector::Zero();
  IntrinsicsScore::Matrix covariance = IntrinsicsScore::Matrix::Zero();
};

// Estimates the corrections but the focal length's, if nobody has calibrated them: by a normal prior and the images.
CorrectionEstimate EstimateUncalibrated(const IntrinsicsScore& score, const IntrinsicsScore::Matrix& score_covariance,
                                        const Camera& camera, IntrinsicsOrigin origin) {
  CorrectionEstimate estimate;
  if (origin == IntrinsicsOrigin::GIVEN) return estimate;
  using Matrix = Eigen::Matrix<double, kNumOthers, kNumOthers>;
  const double radius = HalfDiagonal(camera);
  const double shift = kUncalibratedShift * radius;
  const double radial = kUncalibratedDistortion * radius / std::pow(radius / kRadialUnitPx, 3);
  const Eigen::Matrix<double, kNumOthers, 1> stddevs =
      (origin == IntrinsicsOrigin::SHARED ? kSharedCameraFactor : 1) *
      Eigen::Matrix<double, kNumOthers, 1>(shift, shift, kUncalibratedAspect, radial);
  const Matrix prior = stddevs.cwiseAbs2().asDiagonal();
  const Matrix inverse = score.information.bottomRightCorner<kNumOthers, kNumOthers>().inverse();
  const Matrix variance = inverse * score_covariance.bottomRightCorner<kNumOthers, kNumOthers>() * inverse;
  const Matrix gain = prior * (prior + variance).inverse();
  const Eigen::Matrix<double, kNumOthers, 1> asked = inverse * score.score.tail<kNumOthers>();
  // Leaves the pose as it is without significant evidence, because many cameras, as of renderings, are ideal.
  if (asked.dot(variance.inverse() * asked) > kMinUncalibratedChiSquare) {
    estimate.mean.tail<kNumOthers>() = gain * asked;
  }
  estimate.covariance.bottomRightCorner<kNumOthers, kNumOthers>() = gain * variance;
  return estimate;
}

// Returns what is wrong with principal point or distortion; empty if nothing is, or the focal length explains more.
std::string OtherContradiction(const Camera& camera, const Corrections& corrections, bool is_focal_length_wrong) {
  const auto explains_more = [&](int parameter) {
    return !is_focal_length_wrong || corrections.sigmas[parameter] > corrections.sigmas[LOG_FOCAL_FACTOR];
  };
  const double radius = HalfDiagonal(camera);
  const double corner_px = corrections.joint[RADIAL_DISTORTION] * std::pow(radius / kRadialUnitPx, 3);
  if (corrections.joint_sigmas[RADIAL_DISTORTION] > kMinOtherSigma &&
      std::abs(corner_px) > kMinDistortionShift * radius && explains_more(RADIAL_DISTORTION)) {
    return Format(
        "the images contradict the given distortion: they ask for a radial displacement of the image's corners by "
        "%.1f px",
        corner_px);
  }
  const Eigen::Vector2d shift(corrections.joint[PRINCIPAL_POINT_X], corrections.joint[PRINCIPAL_POINT_Y]);
  const Eigen::Vector2d given = PrincipalPoint(camera), asked = given + shift;
  // Telephoto lenses do not determine the principal point: far from the image's centre, it only shows other errors.
  const Eigen::Vector2d size(static_cast<double>(camera.width), static_cast<double>(camera.height));
  const bool is_plausible = ((asked - size / 2).array().abs() < size.array() / 4).all();
  const int axis = std::abs(shift.x()) > std::abs(shift.y()) ? PRINCIPAL_POINT_X : PRINCIPAL_POINT_Y;
  if (is_plausible && corrections.joint_sigmas[axis] > kMinOtherSigma &&
      shift.norm() > kMinPrincipalPointShift * MeanFocalLength(camera) && explains_more(axis)) {
    return Format("the images contradict the given principal point (%.1f, %.1f): they ask for (%.1f, %.1f)", given.x(),
                  given.y(), asked.x(), asked.y());
  }
  return "";
}

// Returns the tangent of a pose around the world's origin by that around another origin: t = t_origin - R origin.
Eigen::Matrix<double, 6, 6> MoveOrigin(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& origin) {
  Eigen::Matrix<double, 6, 6> moved = Eigen::Matrix<double, 6, 6>::Identity();
  moved.bottomLeftCorner<3, 3>() = Hat(rotation * origin);
  return moved;
}

using PoseDerivatives = Eigen::Matrix<double, 6, NUM_INTRINSICS_PARAMETERS>;

// Returns the derivatives of an image's pose in the world by those of its frame around the layout's origin.
PoseDerivatives DerivativesInWorld(const Layout& layout, const PosedImages& posed, int query,
                                   const PoseDerivatives& of_frame) {
  const Eigen::Matrix3d cam_from_frame = posed.images[query].cam_from_frame.rotation.toRotationMatrix();
  PoseDerivatives of_image;
  of_image << cam_from_frame * of_frame.topRows<3>(), cam_from_frame * of_frame.bottomRows<3>();
  return MoveOrigin(CamFromWorld(posed, query).rotation, layout.origin) * of_image;
}

Rigid3d PoseInWorld(const Layout& layout, const PosedImages& posed, int query) {
  Rigid3d pose = CamFromWorld(posed, query);
  pose.translation -= pose.rotation * layout.origin;
  return pose;
}

void Move(const Eigen::Matrix<double, 6, 1>& tangent, Rigid3d* pose) {
  pose->rotation = (ExpSO3(tangent.head<3>()) * pose->rotation).normalized();
  pose->translation += tangent.tail<3>();
}

// Adds to the uncertainty of a pose.
void AddCovariance(const Eigen::Matrix<double, 6, 6>& covariance, const Rigid3d& cam_from_world,
                   PoseUncertainty* uncertainty) {
  const Eigen::Matrix<double, 6, 6> sum = uncertainty->covariance + covariance;
  uncertainty->covariance = (sum + sum.transpose()) / 2;
  // Moves the origin to the camera, because the position's part would be lost in large coordinates.
  const Eigen::Matrix<double, 6, 6> local_from_world = MoveOrigin(cam_from_world.rotation, -CamInWorld(cam_from_world));
  const Eigen::Matrix<double, 6, 6> local = local_from_world * uncertainty->covariance * local_from_world.transpose();
  uncertainty->spread =
      ComputePoseSpread({cam_from_world.rotation, Eigen::Vector3d::Zero()}, (local + local.transpose()) / 2);
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
  const auto density = [&](double prior_stddev) {
    return NormalDensity(log_factor, prior_stddev * prior_stddev + variance);
  };
  const double right = (1 - prior) * density(right_stddev), wrong = prior * density(kWrongStddev);
  const double slight = std::min(std::max(kSlightlyWrongProbability, prior), 1 - prior) * density(kSlightlyWrongStddev);
  FocalLengthJudgement judgement;
  judgement.wrong_probability = wrong + right > 0 ? wrong / (wrong + right) : 1;
  judgement.mean_square = (wrong * MeanSquare(kWrongStddev, log_factor, variance) +
                           slight * MeanSquare(kSlightlyWrongStddev, log_factor, variance) +
                           right * MeanSquare(right_stddev, log_factor, variance)) /
                          std::max(wrong + slight + right, 1e-300);
  if (options.focal_length_stddev_ratio == 0 && origin == IntrinsicsOrigin::GIVEN) judgement.mean_square = 0;
  return judgement;
}

void AddFocalLengthUncertainty(double mean_square, const Rigid3d& cam_from_world, IntrinsicsResult* intrinsics,
                               PoseUncertainty* uncertainty) {
  const Eigen::Matrix<double, 6, 1>& derivative = intrinsics->pose_from_log_focal;
  AddCovariance(mean_square * derivative * derivative.transpose(), cam_from_world, uncertainty);
  intrinsics->mean_square += mean_square;
}

std::string FocalLengthContradiction(const Camera& camera, double factor, double factor_stddev) {
  const double given_px = MeanFocalLength(camera);
  return Format("the images contradict the given focal length of %.1f px: they ask for %.1f +- %.1f px", given_px,
                factor * given_px, factor_stddev * given_px);
}

std::vector<IntrinsicsResult> CheckIntrinsics(const QueryGroup& group, const Layout& layout, const Refined& refined,
                                              const LocalizerOptions& options,
                                              std::vector<PoseUncertainty>* uncertainties, PosedImages* reported,
                                              const QueryCamera* camera) {
  const BundleAdjustmentResult& adjustment = refined.adjustment;
  const double factor =
      VarianceFactor(adjustment.posed, adjustment.tracks, RobustLoss(options.bundle_adjustment.loss_scale_sigma));
  std::vector<IntrinsicsResult> results;
  for (int query = 0; query < layout.num_queries; ++query) {
    const LocalizationProblem& problem = group.images[query].problem;
    const IntrinsicsScore& score = adjustment.intrinsics_scores[layout.FrameOf(query)];
    IntrinsicsResult result;
    result.origin = problem.intrinsics_origin;
    const IntrinsicsScore::Matrix noise = ScoreCovariance(score, adjustment, factor);
    const Corrections corrections = Estimate(score, noise, result.origin == IntrinsicsOrigin::GIVEN);
    result.focal_factor = camera != nullptr ? camera->FocalFactor() : std::exp(corrections.log_focal_factor);
    result.focal_factor_stddev = result.focal_factor * corrections.log_focal_stddev;
    const Rigid3d pose = PoseInWorld(layout, adjustment.posed, query);
    const PoseDerivatives derivatives =
        DerivativesInWorld(layout, adjustment.posed, query, score.frame_from_correction);
    result.pose_from_log_focal = derivatives.col(LOG_FOCAL_FACTOR);
    PoseUncertainty& uncertainty = (*uncertainties)[query];
    const CorrectionEstimate others = EstimateUncalibrated(score, noise, problem.query_camera, result.origin);
    AddCovariance(derivatives * others.covariance * derivatives.transpose(), pose, &uncertainty);
    const int frame = layout.FrameOf(query);
    if (layout.QueriesOf(frame).front() == query) {
      Move(score.frame_from_correction * others.mean, &reported->frames[frame].frame_from_world);
    }
    if (camera != nullptr) {
      result.verdict = IntrinsicsVerdict::REFINED;
      result.contradiction = OtherContradiction(problem.query_camera, corrections, /*is_focal_length_wrong=*/false);
      // Adds what the errors that images share do to the estimate, because the adjustment does not know them.
      const double mean_square = (1 - std::pow(kSharedErrorFactor, -2)) * std::pow(corrections.log_focal_stddev, 2);
      AddFocalLengthUncertainty(mean_square, pose, &result, &uncertainty);
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
    AddFocalLengthUncertainty(judgement.mean_square, pose, &result, &uncertainty);
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

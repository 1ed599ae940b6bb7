#include "colmap_lazyloc/intrinsics/intrinsics_judgement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "colmap_lazyloc/bridge/camera_models.h"
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
// Probability that a value is wrong before the images are used.
constexpr double kWrongGivenProbability = 0.05;
constexpr double kWrongExifProbability = 0.5;
// Significance, and displacement from which on principal point (as a fraction of the focal length) or distortion (at
// the image's corners, of half the diagonal) count as contradicted. Rolling shutters look like a distortion of 5
// deviations.
constexpr double kMinOtherSigma = 5;
constexpr double kMinPrincipalPointShift = 0.02;
constexpr double kMinDistortionShift = 0.015;

double LogNormalDensity(double x, double variance) { return -(x * x / variance + std::log(variance)) / 2; }

// Returns the expected square of a normally distributed deviation after a measurement.
double MeanSquare(double stddev, double measured, double measured_variance) {
  const double variance = stddev * stddev;
  const double gain = variance / (variance + measured_variance);
  return gain * gain * measured * measured + gain * measured_variance;
}

// Returns what a sentence calls intrinsics of this origin, in front of the noun.
const char* Determiner(IntrinsicsOrigin origin) {
  switch (origin) {
    case IntrinsicsOrigin::GIVEN: return "the given";
    case IntrinsicsOrigin::MODEL: return "the model's";
    case IntrinsicsOrigin::JOINT: return "the shared";
    case IntrinsicsOrigin::SHARED:
    case IntrinsicsOrigin::SIMILAR: return "the database camera's";
    case IntrinsicsOrigin::EXIF: return "EXIF's";
    case IntrinsicsOrigin::GUESS: return "the guessed";
  }
  return "";
}

// Returns what is wrong with principal point or distortion; empty if nothing is.
std::string OtherContradiction(const Camera& camera, IntrinsicsOrigin origin, const IntrinsicsEstimate& estimate) {
  const double radius = HalfDiagonalPx(camera);
  const double corner_px = estimate.corrections[RADIAL_DISTORTION] * std::pow(radius / kRadialUnitPx, 3);
  if (estimate.sigmas[RADIAL_DISTORTION] > kMinOtherSigma && std::abs(corner_px) > kMinDistortionShift * radius) {
    return Format("the images contradict %s distortion: the image's corners are %.0f px further %s", Determiner(origin),
                  std::abs(corner_px), corner_px > 0 ? "outside" : "inside");
  }
  const Eigen::Vector2d shift(estimate.corrections[PRINCIPAL_POINT_X], estimate.corrections[PRINCIPAL_POINT_Y]);
  const Eigen::Vector2d given = PrincipalPoint(camera), suggested = given + shift;
  // Telephoto lenses do not determine the principal point: far from the image's centre, it only shows other errors.
  const Eigen::Vector2d size(static_cast<double>(camera.width), static_cast<double>(camera.height));
  const bool is_plausible = ((suggested - size / 2).array().abs() < size.array() / 4).all();
  const int axis = std::abs(shift.x()) > std::abs(shift.y()) ? PRINCIPAL_POINT_X : PRINCIPAL_POINT_Y;
  if (is_plausible && estimate.sigmas[axis] > kMinOtherSigma &&
      shift.norm() > kMinPrincipalPointShift * MeanFocalLength(camera)) {
    return Format("the images suggest the principal point (%.0f, %.0f), not %s (%.0f, %.0f)", suggested.x(),
                  suggested.y(), Determiner(origin), given.x(), given.y());
  }
  return "";
}

}  // namespace

FocalLengthJudgement JudgeFocalLength(double log_factor, double stddev, IntrinsicsOrigin origin,
                                      const LocalizerOptions& options) {
  const double right_stddev = std::max(options.focal_length_stddev_ratio, kMinRightStddev);
  const double variance = stddev * stddev;
  const double p_wrong = origin == IntrinsicsOrigin::GUESS   ? 1
                         : origin == IntrinsicsOrigin::MODEL ? 0
                         : origin == IntrinsicsOrigin::EXIF  ? kWrongExifProbability
                                                             : kWrongGivenProbability;
  // Takes logs relative to the most probable case, because all densities of a strange measurement are zero.
  const std::array<double, 3> stddevs = {right_stddev, kSlightlyWrongStddev, kWrongStddev};
  std::array<double, 3> probabilities = {1 - p_wrong,
                                         std::min(std::max(kSlightlyWrongProbability, p_wrong), 1 - p_wrong), p_wrong};
  std::array<double, 3> log_densities;
  double max_log_density = -std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < stddevs.size(); ++i) {
    log_densities[i] = LogNormalDensity(log_factor, stddevs[i] * stddevs[i] + variance);
    if (probabilities[i] > 0) max_log_density = std::max(max_log_density, log_densities[i]);
  }
  double sum = 0;
  FocalLengthJudgement judgement;
  for (size_t i = 0; i < stddevs.size(); ++i) {
    probabilities[i] *= probabilities[i] > 0 ? std::exp(log_densities[i] - max_log_density) : 0;
    sum += probabilities[i];
    judgement.mean_square += probabilities[i] * MeanSquare(stddevs[i], log_factor, variance);
  }
  judgement.mean_square /= sum;
  const double right = probabilities[0], wrong = probabilities[2];
  judgement.wrong_probability = p_wrong > 0 ? wrong / std::max(wrong + right, 1e-300) : 0;
  if (options.focal_length_stddev_ratio == 0 && IsCalibrated(origin)) judgement.mean_square = 0;
  return judgement;
}

double JudgeIntrinsics(const Camera& camera, const IntrinsicsEstimate& estimate, bool is_refined,
                       const LocalizerOptions& options, IntrinsicsResult* result) {
  if (is_refined) {
    result->verdict = IntrinsicsVerdict::REFINED;
    result->contradiction = OtherContradiction(camera, result->origin, estimate);
    // Returns what the adjustment does not know of the estimate's error.
    return (1 - 1 / estimate.common_error_factor) * std::pow(estimate.log_focal_stddev, 2);
  }
  const FocalLengthJudgement focal_length =
      JudgeFocalLength(estimate.log_focal_factor, estimate.log_focal_stddev, result->origin, options);
  const bool is_guess = result->origin == IntrinsicsOrigin::GUESS;
  const bool is_wrong = focal_length.wrong_probability > 0.5 && !is_guess;
  if (result->origin != IntrinsicsOrigin::MODEL) {
    result->contradiction = OtherContradiction(camera, result->origin, estimate);
  }
  if (result->contradiction.empty() && is_wrong) {
    result->contradiction = FocalLengthContradiction(camera, *result);
  }
  result->verdict = !result->contradiction.empty()                                 ? IntrinsicsVerdict::CONTRADICTED
                    : estimate.log_focal_stddev > kMaxObservableStddev || is_guess ? IntrinsicsVerdict::UNOBSERVABLE
                                                                                   : IntrinsicsVerdict::CONFIRMED;
  return focal_length.mean_square;
}

std::string FocalLengthContradiction(const Camera& camera, const IntrinsicsResult& result) {
  const double before_px = MeanFocalLength(camera), stddev_px = result.focal_factor_stddev * before_px;
  return Format("the images suggest a focal length of %.0f +- %.*f px, not %s %.0f px", result.focal_factor * before_px,
                stddev_px < 1 ? 1 : 0, stddev_px, Determiner(result.origin), before_px);
}

}  // namespace lazyloc

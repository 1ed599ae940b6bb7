#include "colmap_lazyloc/pipeline/localize_lone.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/pipeline/confidence.h"
#include "colmap_lazyloc/pipeline/focal_length.h"
#include "colmap_lazyloc/pipeline/intrinsics_check.h"
#include "colmap_lazyloc/pipeline/intrinsics_judgement.h"
#include "colmap_lazyloc/pipeline/localize_together.h"
#include "colmap_lazyloc/scene/stage_timer.h"

namespace lazyloc {
namespace {

// Probability that a focal length is wrong above which estimating it decides, and the standard deviation of its log
// from which on its score is no evidence: far from the right value, the noise that adjustment estimates is too large.
constexpr double kMinDoubt = 0.01;
constexpr double kMaxConclusiveStddev = 0.01;
// Standard deviation of the log of an estimate up to which it can confirm a given focal length.
constexpr double kMaxConfirmingStddev = 0.02;
// Factor between the odds of two poses being wrong up to which these count as equally credible.
constexpr double kMaxDoubtRatio = 2;
// Maximum factor between an estimated focal length and that of the alternative camera.
constexpr double kMaxAlternativeFactor = 1.1;

FocalLengthJudgement Judge(const IntrinsicsResult& intrinsics, const LocalizerOptions& options) {
  return JudgeFocalLength(std::log(intrinsics.focal_factor), intrinsics.focal_factor_stddev / intrinsics.focal_factor,
                          intrinsics.origin, options);
}

bool IsInDoubt(const LocalizationResult& result, const LocalizerOptions& options) {
  const IntrinsicsResult& intrinsics = result.intrinsics;
  if (result.status == QueryStatus::INCONSISTENT_INTRINSICS) return true;
  if (!HasPose(result.status)) return intrinsics.origin != IntrinsicsOrigin::GIVEN;
  return intrinsics.focal_factor_stddev > kMaxConclusiveStddev * intrinsics.focal_factor ||
         Judge(intrinsics, options).wrong_probability > kMinDoubt;
}

// True if a pose with an estimated focal length leaves more doubt than that with the other intrinsics. Then it is no
// evidence against these, because some focal length fits false matches, and heights in nadir images.
bool IsLessCredible(const LocalizationResult& refined, const LocalizationResult& given) {
  const auto odds = [](const LocalizationResult& result) { return 1 / result.confidence.value_or(0) - 1; };
  return odds(refined) > kMaxDoubtRatio * odds(given);
}

// Returns the result with the given focal length if an estimate does not contradict it, even if its score did.
LocalizationResult Kept(LocalizationResult given, const IntrinsicsResult& estimate, const LocalizerOptions& options) {
  given.status = QueryStatus::LOCALIZED;
  given.reason.clear();
  RequireConfidence(options.min_confidence, &given);
  given.intrinsics.contradiction.clear();
  given.intrinsics.focal_factor = estimate.focal_factor;
  given.intrinsics.focal_factor_stddev = estimate.focal_factor_stddev;
  given.intrinsics.verdict = estimate.focal_factor_stddev > kMaxConfirmingStddev * estimate.focal_factor
                                 ? IntrinsicsVerdict::UNOBSERVABLE
                                 : IntrinsicsVerdict::CONFIRMED;
  const double missing = Judge(given.intrinsics, options).mean_square - given.intrinsics.mean_square;
  if (missing <= 0) return given;
  PoseUncertainty uncertainty{given.covariance, given.spread};
  AddFocalLengthUncertainty(missing, given.cam_from_world, &given.intrinsics, &uncertainty);
  given.covariance = uncertainty.covariance;
  given.spread = uncertainty.spread;
  return given;
}

// Decides between the result with the given intrinsics and the one with an estimated focal length.
LocalizationResult Decide(LocalizationResult given, LocalizationResult refined, const LocalizerOptions& options) {
  if (refined.status == QueryStatus::UNKNOWN_CAMERA && given.status == QueryStatus::INCONSISTENT_INTRINSICS) {
    const IntrinsicsResult unobservable = given.intrinsics;  // focal length and distance cannot be told apart
    return Kept(std::move(given), unobservable, options);
  }
  if (!HasPose(refined.status)) return given;
  if (HasPose(given.status) && IsLessCredible(refined, given)) return given;
  const bool is_wrong = Judge(refined.intrinsics, options).wrong_probability > 0.5;
  if (given.intrinsics.origin != IntrinsicsOrigin::GIVEN) {
    const bool is_kept = !is_wrong && HasPose(given.status);
    return is_kept ? Kept(std::move(given), refined.intrinsics, options) : refined;
  }
  const std::string& other = refined.intrinsics.contradiction;  // of principal point or distortion
  if (!is_wrong && other.empty()) {
    return Kept(std::move(given), refined.intrinsics, options);
  }
  given.status = QueryStatus::INCONSISTENT_INTRINSICS;
  given.intrinsics.verdict = IntrinsicsVerdict::CONTRADICTED;
  given.intrinsics.focal_factor = refined.intrinsics.focal_factor;
  given.intrinsics.focal_factor_stddev = refined.intrinsics.focal_factor_stddev;
  given.reason = other.empty() ? FocalLengthContradiction(given.query_camera, refined.intrinsics.focal_factor,
                                                          refined.intrinsics.focal_factor_stddev)
                               : other;
  given.intrinsics.contradiction = given.reason;
  return given;
}

// Returns the query with another camera. The pairs keep their matches, but not relative poses, which depend on it.
QueryGroup WithCamera(QueryGroup query, const CandidateCamera& camera) {
  LocalizationProblem& problem = query.images.front().problem;
  problem.query_camera = camera.camera;
  problem.intrinsics_origin = camera.origin;
  problem.alternative_camera.reset();
  for (ImagePair& pair : problem.pairs) {
    if (!pair.geometry) continue;
    const TwoViewConfig config = pair.geometry->config;
    if (HoldsCalibrated(config) || config == TwoViewConfig::UNCALIBRATED) ForgetIntrinsics(&*pair.geometry);
  }
  return query;
}

// Returns true if an estimated focal length is near that of the alternative camera, which may then be the right one.
// The bound is wide, because false matches can pull an estimate by more than its standard deviation.
bool IsNearAlternative(const LocalizationProblem& problem, const LocalizationResult& result) {
  const IntrinsicsResult& estimate = result.intrinsics;
  if (!problem.alternative_camera || estimate.verdict != IntrinsicsVerdict::REFINED) return false;
  const Camera& other = problem.alternative_camera->camera;
  if (!HasPose(result.status) || !HasFocalLength(other)) return false;
  const double factor = estimate.focal_factor * MeanFocalLength(problem.query_camera) / MeanFocalLength(other);
  return std::abs(std::log(factor)) < std::log(kMaxAlternativeFactor);
}

// Returns true if the images give a rotation and nothing of the position, which a prior gives.
bool IsPositionLeftToPrior(const LocalizationResult& result) {
  return result.status == QueryStatus::DEGENERATE_BASELINE && result.partial_pose && !result.partial_pose->bearing &&
         result.priors.position && result.priors.position->verdict == PriorVerdict::NOT_TESTED;
}

// Returns true if all database images are at one place, and a prior may give the distance from there.
bool IsDistanceLeftToPrior(const LocalizationResult& result) {
  return result.status == QueryStatus::SCALE_UNOBSERVABLE && result.pairs.size() > 1 && result.partial_pose &&
         result.partial_pose->bearing && result.priors.position &&
         result.priors.position->verdict == PriorVerdict::NOT_TESTED;
}

// Returns true if a prior fixes the distance of a pose.
bool IsDistanceByPrior(const LocalizationResult& result) {
  return HasPose(result.status) && result.priors.position && result.priors.position->fixes == PriorRole::DISTANCE;
}

// Returns true if motion averaging may have left a single one of several pairs, because their relative poses contradict
// it.
bool MayBeOnePairLeft(const LocalizationResult& result) {
  return (result.status == QueryStatus::SCALE_UNOBSERVABLE || IsDistanceByPrior(result)) &&
         std::count_if(result.pairs.begin(), result.pairs.end(),
                       [](const PairResult& pair) { return pair.num_inliers > 0; }) > 1;
}

// Returns the query with the pair of one database image alone.
QueryGroup WithPair(QueryGroup query, const std::string& database_name) {
  std::vector<ImagePair>& pairs = query.images.front().problem.pairs;
  const auto is_other = [&](const ImagePair& pair) { return pair.other_name != database_name; };
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(), is_other), pairs.end());
  return query;
}

}  // namespace

LocalizationResult LocalizeLone(const QueryGroup& query, const LocalizerOptions& options) {
  const auto localize = [&](const auto& method) { return std::move(method(query, options).results.front()); };
  if (options.post_optimization != PostOptimization::TRACKS) return localize(LocalizeWithoutTracks);
  if (IsFocalLengthUnknown(query.images.front().problem, options)) {
    LocalizationResult refined = localize(LocalizeWithUnknownFocalLength);
    if (options.intrinsics == IntrinsicsMode::REFINE || HasPose(refined.status)) return refined;
    // Tries the guess, because the scene may fix the pose even if it does not fix the focal length.
    LocalizationResult guessed = localize(LocalizeTogether);
    return HasPose(guessed.status) ? guessed : refined;
  }
  LocalizationResult given = localize(LocalizeTogether);
  if (MayBeOnePairLeft(given)) {
    LocalizationResult other = localize(LocalizeByOtherStarts);
    // Accepts nothing that rests on epipolar constraints alone, because relative poses contradict each other.
    const bool has_points = other.evidence.num_common_tracks >= options.min_num_tracks;
    if (other.status == QueryStatus::LOCALIZED && has_points && !IsDistanceByPrior(other)) return other;
  }
  if (IsPositionLeftToPrior(given)) return localize(LocalizeByRotation);
  // Takes the one image with the best bearing, because images of one place do not triangulate points.
  if (IsDistanceLeftToPrior(given)) {
    return LocalizeLone(WithPair(query, given.partial_pose->bearing->database_name), options);
  }
  const LocalizationProblem& problem = query.images.front().problem;
  const bool can_refine = options.intrinsics == IntrinsicsMode::AUTO && HasFocalLength(problem.query_camera) &&
                          problem.intrinsics_origin != IntrinsicsOrigin::MODEL;
  if (!can_refine || !IsInDoubt(given, options)) return given;
  LocalizationResult refined = localize(LocalizeWithUnknownFocalLength);
  StageTimer::Seconds seconds = given.seconds;
  for (const auto& [stage, time] : refined.seconds) StageTimer::Add(stage, time, &seconds);
  LocalizationResult result = Decide(std::move(given), std::move(refined), options);
  if (IsNearAlternative(problem, result)) {
    LocalizationResult other = LocalizeLone(WithCamera(query, *problem.alternative_camera), options);
    for (const auto& [stage, time] : other.seconds) StageTimer::Add(stage, time, &seconds);
    if (HasPose(other.status) && other.intrinsics.verdict == IntrinsicsVerdict::CONFIRMED) result = std::move(other);
  }
  result.seconds = std::move(seconds);
  return result;
}

}  // namespace lazyloc

#include "colmap_lazyloc/pipeline/choose.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>

#include "colmap_lazyloc/intrinsics/intrinsics_judgement.h"
#include "colmap_lazyloc/uncertainty/confidence.h"

namespace lazyloc {
namespace {

// Probability that a focal length is wrong above which estimating it decides.
constexpr double kMinWrongProbability = 0.01;
// Standard deviation of its log from which on its score tells nothing, because far from the right value, the noise that
// adjustment estimates is too large.
constexpr double kMaxConclusiveStddev = 0.01;

// The functions below are for groups of one query.

const IntrinsicsResult& IntrinsicsOf(const Solution& solution) { return solution.checked.results.front(); }

double LogFocalStddev(const IntrinsicsResult& intrinsics) {
  return intrinsics.focal_factor_stddev / intrinsics.focal_factor;
}

FocalLengthJudgement Judge(const IntrinsicsResult& intrinsics, const LocalizerOptions& options) {
  return JudgeFocalLength(std::log(intrinsics.focal_factor), LogFocalStddev(intrinsics), intrinsics.origin, options);
}

// Returns true if an estimate that contradicts intrinsics does not replace them: somebody has stated them, or several
// queries share them, and an attempt without these follows.
bool AreFixed(IntrinsicsOrigin origin) {
  return origin == IntrinsicsOrigin::GIVEN || origin == IntrinsicsOrigin::JOINT;
}

// Returns the contradiction for which a frame is refused; null if there is none. In IntrinsicsMode::GIVEN, a
// contradiction is no reason to refuse a pose.
const IntrinsicsResult* RefusedIntrinsics(const Choice& choice, int frame, const LocalizerOptions& options) {
  if (options.intrinsics == IntrinsicsMode::GIVEN) return nullptr;
  for (const int query : choice.solution->prepared->layout.QueriesOf(frame)) {
    if (choice.intrinsics[query].verdict == IntrinsicsVerdict::CONTRADICTED) return &choice.intrinsics[query];
  }
  return nullptr;
}

Choice AsSolved(const Solution& solution) { return {&solution, solution.checked.results, 0}; }

bool HasPose(const Solution& solution, const LocalizerOptions& options) {
  return FramesWithoutPose(AsSolved(solution), options).empty();
}

bool AreContradicted(const Solution& solution, const LocalizerOptions& options) {
  return !solution.failure && !HasPose(solution, options);
}

double ConfidenceOf(const Solution& solution) { return Confidence(solution.evidence.front()); }

// Returns a solution with a given focal length, and what an estimate says of it.
Choice WithEstimate(const Solution& given, const IntrinsicsResult& estimate, IntrinsicsVerdict verdict,
                    const std::string& contradiction) {
  Choice choice = AsSolved(given);
  choice.intrinsics.front() = {IntrinsicsOf(given).origin, verdict, estimate.focal_factor, estimate.focal_factor_stddev,
                               contradiction};
  return choice;
}

// Returns the solution with the given focal length if an estimate does not contradict it, even if its score did.
Choice KeepGiven(const Solution& given, const IntrinsicsResult& estimate, const LocalizerOptions& options) {
  const bool is_certain = LogFocalStddev(estimate) <= kMaxObservableStddev;
  Choice choice =
      WithEstimate(given, estimate, is_certain ? IntrinsicsVerdict::CONFIRMED : IntrinsicsVerdict::UNOBSERVABLE, "");
  choice.extra_log_focal_variance =
      Judge(choice.intrinsics.front(), options).mean_square - given.checked.poses.front().log_focal_variance;
  return choice;
}

// Returns the solution with a given focal length that an estimate contradicts, or its principal point or distortion.
Choice ContradictGiven(const Solution& given, const IntrinsicsResult& estimate) {
  const Camera& camera = given.prepared->group.images.front().problem.query_camera;
  return WithEstimate(
      given, estimate, IntrinsicsVerdict::CONTRADICTED,
      !estimate.contradiction.empty() ? estimate.contradiction : FocalLengthContradiction(camera, estimate));
}

// Decides between the given intrinsics and an estimated focal length.
Choice GivenOrEstimated(const Solution& given, const Solution& refined, const LocalizerOptions& options) {
  const bool has_pose = HasPose(given, options);
  const IntrinsicsOrigin origin = IntrinsicsOf(given).origin;
  if (refined.failure) {
    const bool is_unobservable = refined.failure->cause == QueryStatus::UNKNOWN_CAMERA;
    // Neither a failure with a guess nor a pose with a guess that the images cannot judge says anything.
    if (origin == IntrinsicsOrigin::GUESS && (is_unobservable || !has_pose)) return AsSolved(refined);
    // A contradiction that comes from telling focal length and distance apart is none if the images cannot.
    return is_unobservable && AreContradicted(given, options) ? KeepGiven(given, IntrinsicsOf(given), options)
                                                              : AsSolved(given);
  }
  // A pose that would be refused does not speak against one that is more probable, because some focal length fits false
  // matches.
  if (has_pose && ConfidenceOf(refined) < std::min(ConfidenceOf(given), options.min_confidence)) return AsSolved(given);
  const IntrinsicsResult& estimate = IntrinsicsOf(refined);
  const bool is_wrong = Judge(estimate, options).wrong_probability > 0.5;
  if (!AreFixed(origin)) return has_pose && !is_wrong ? KeepGiven(given, estimate, options) : AsSolved(refined);
  // Contradicted intrinsics that somebody has stated are for them to mend.
  return is_wrong || !estimate.contradiction.empty() ? ContradictGiven(given, estimate)
                                                     : KeepGiven(given, estimate, options);
}

// Compares the choice among the solutions so far with the next one.
Choice Better(const Choice& choice, const Solution& next, const LocalizerOptions& options) {
  const Solution& chosen = *choice.solution;
  if (next.hypothesis.estimates_focal_length) return GivenOrEstimated(chosen, next, options);
  if (chosen.hypothesis.estimates_focal_length) return GivenOrEstimated(next, chosen, options);
  // Others are tried if nothing else is left for the position: rotations alone, or the pair of one database image.
  return AsSolved(next);
}

}  // namespace

Choice Choose(const std::vector<Solution>& solutions, const LocalizerOptions& options) {
  Choice choice = AsSolved(solutions.front());
  for (size_t i = 1; i < solutions.size(); ++i) choice = Better(choice, solutions[i], options);
  for (const Solution& other : solutions) {
    if (&other == choice.solution || other.evidence.empty()) continue;
    if (choice.runner_up == nullptr || ConfidenceOf(other) > ConfidenceOf(*choice.runner_up)) choice.runner_up = &other;
  }
  return choice;
}

std::optional<Refusal> RefusalOf(const Choice& choice, int query, const LocalizerOptions& options) {
  const Solution& solution = *choice.solution;
  const int frame = solution.prepared->group.images[query].frame;
  if (solution.failure) return Refusal{solution.failure->cause, solution.failure->ReasonOf(frame)};
  if (const IntrinsicsResult* refused = RefusedIntrinsics(choice, frame, options)) {
    return Refusal{QueryStatus::INCONSISTENT_INTRINSICS, refused->contradiction};
  }
  if (solution.evidence.empty()) return std::nullopt;
  const PoseEvidence& evidence = solution.evidence[frame];
  const double confidence = Confidence(evidence);
  if (!(confidence < options.min_confidence)) return std::nullopt;
  return Refusal{QueryStatus::LOW_CONFIDENCE, LowConfidenceReason(evidence, confidence, options.min_confidence)};
}

ImageChoice Better(ImageChoice earlier, ImageChoice later, const LocalizerOptions& options) {
  const auto is_refused = [&](const ImageChoice& image) { return RefusalOf(*image.choice, image.query, options); };
  const bool is_later_better = is_refused(earlier) && !is_refused(later);
  for (const auto& [stage, elapsed] : later.seconds) StageTimer::Add(stage, elapsed, &earlier.seconds);
  if (!is_later_better) return earlier;
  later.seconds = std::move(earlier.seconds);
  return later;
}

std::vector<int> FramesWithoutPose(const Choice& choice, const LocalizerOptions& options) {
  const Prepared& prepared = *choice.solution->prepared;
  const std::optional<Failure>& failure = choice.solution->failure;
  std::vector<int> frames;
  if (failure && !failure->frames.empty()) return failure->frames;
  for (int frame = 0; frame < static_cast<int>(prepared.group.frame_names.size()); ++frame) {
    if (failure || RefusedIntrinsics(choice, frame, options) != nullptr) {
      frames.push_back(frame);
    }
  }
  return frames;
}

bool IsRefused(const Solution& solution, const LocalizerOptions& options) {
  return !HasPose(solution, options) || ConfidenceOf(solution) < options.min_confidence;
}

bool IsFocalLengthUncertain(const Solution& given, const LocalizerOptions& options) {
  const IntrinsicsResult& intrinsics = IntrinsicsOf(given);
  if (AreContradicted(given, options)) return true;
  if (given.failure) return !AreFixed(intrinsics.origin);
  return !(LogFocalStddev(intrinsics) <= kMaxConclusiveStddev) ||
         Judge(intrinsics, options).wrong_probability > kMinWrongProbability;
}

}  // namespace lazyloc

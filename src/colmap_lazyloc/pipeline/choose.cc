#include "colmap_lazyloc/pipeline/choose.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>

#include "colmap_lazyloc/intrinsics/intrinsics_judgement.h"
#include "colmap_lazyloc/priors/plane_orientation.h"
#include "colmap_lazyloc/priors/query_priors.h"
#include "colmap_lazyloc/uncertainty/confidence.h"
#include "colmap_lazyloc/uncertainty/position_ambiguity.h"

namespace lazyloc {
namespace {

// Probability that a focal length is wrong above which estimating it decides.
constexpr double kMinWrongProbability = 0.01;
// Standard deviation of its log from which on its score tells nothing, because far from the right value, the noise that
// adjustment estimates is too large.
constexpr double kMaxConclusiveStddev = 0.01;
// Minimum difference of the squared errors, in standard deviations, that excludes an orientation: odds of 100 to 1.
constexpr double kMinDifference = 9.21;
// Minimum share of the matches in tracks with which a pose is the only one if its other orientation has none.
constexpr double kMinTrackRatio = 0.5;

// The functions below are for groups of one query.

const IntrinsicsResult& IntrinsicsOf(const Choice& choice) { return choice.solution->checked.results.front(); }

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

bool HasPose(const Choice& choice, const LocalizerOptions& options) {
  return FramesWithoutPose(choice, options).empty();
}

bool AreContradicted(const Choice& choice, const LocalizerOptions& options) {
  return !choice.failure && !HasPose(choice, options);
}

double ConfidenceOf(const Choice& choice) { return Confidence(choice.solution->evidence.front()); }

// Chooses between the two orientations of a query beside one database image, by the matches and the priors. What is
// known of the position, which both mostly leave open, depends on whether one of them is excluded.
Choice BetterOrientation(const Solution& first, const Solution& other) {
  const Layout& layout = first.prepared->layout;
  const PairRefs& pairs = first.averaged.pairs;
  const std::vector<Track>& matches = first.input->tracks.rest;
  const auto tracks_of = [&](const Solution& solution) {
    return TracksByFrame(layout, solution.refined->adjustment.tracks)[0];
  };
  Choice choice(first);
  if (other.refined) {
    const std::optional<double> advantage = CompareOrientations(layout, pairs, matches, *first.refined, *other.refined);
    if (advantage && *advantage < -kMinDifference) choice = Choice(other);
    choice.has_one_orientation = !advantage || std::abs(*advantage) > kMinDifference;
  } else if (static_cast<double>(tracks_of(first).size()) > kMinTrackRatio * static_cast<double>(matches.size())) {
    choice.has_one_orientation = true;
  }
  if (!choice.has_one_orientation || !IsPositionOpen(choice)) return choice;
  const Refined& refined = *choice.solution->refined;
  choice.failure = UnobservablePositionFailure({layout, pairs, refined.adjustment, 0, tracks_of(*choice.solution),
                                                refined.variance_factor, choice.has_one_orientation});
  choice.failure->frames = {0};
  return choice;
}

// Returns the solution with a position that a prior fixes, if the images and the prior were reconciled.
Choice WithPositionPrior(Choice by_images, const Solution& by_prior) {
  if (by_prior.refined && AreReconciled(*by_prior.refined)) return Choice(by_prior);
  by_images.priors = by_prior.priors;
  if (by_prior.refined) by_images.priors.front().position->verdict = PriorVerdict::CONTRADICTED;
  return by_images;
}

// Chooses among solutions with given intrinsics.
Choice BetterGiven(Choice choice, const Solution& next) {
  switch (next.hypothesis.approach) {
    case Approach::OTHER_ORIENTATION: return BetterOrientation(*choice.solution, next);
    case Approach::POSITION_PRIOR: return WithPositionPrior(std::move(choice), next);
    // Others are tried if nothing else is left for the position: rotations alone, or the pair of one database image.
    default: return Choice(next);
  }
}

// Returns a solution with a given focal length, and what an estimate says of it.
Choice WithEstimate(const Choice& given, const IntrinsicsResult& estimate, IntrinsicsVerdict verdict,
                    const std::string& contradiction) {
  Choice choice = given;
  IntrinsicsResult& intrinsics = choice.intrinsics.front();
  intrinsics.focal_factor = estimate.focal_factor;
  intrinsics.focal_factor_stddev = estimate.focal_factor_stddev;
  intrinsics.verdict = verdict;
  intrinsics.contradiction = contradiction;
  return choice;
}

// Returns the solution with the given focal length if an estimate does not contradict it, even if its score did.
Choice KeepGiven(const Choice& given, const IntrinsicsResult& estimate, const LocalizerOptions& options) {
  const bool is_certain = LogFocalStddev(estimate) <= kMaxObservableStddev;
  Choice choice =
      WithEstimate(given, estimate, is_certain ? IntrinsicsVerdict::CONFIRMED : IntrinsicsVerdict::UNOBSERVABLE, "");
  choice.extra_log_focal_variance =
      Judge(choice.intrinsics.front(), options).mean_square - given.solution->checked.poses.front().log_focal_variance;
  return choice;
}

// Returns the solution with a given focal length that an estimate contradicts, or its principal point or distortion.
Choice ContradictGiven(const Choice& given, const IntrinsicsResult& estimate) {
  const Camera& camera = given.solution->prepared->group.images.front().problem.query_camera;
  return WithEstimate(
      given, estimate, IntrinsicsVerdict::CONTRADICTED,
      !estimate.contradiction.empty() ? estimate.contradiction : FocalLengthContradiction(camera, estimate));
}

// Decides between the given intrinsics and an estimated focal length.
Choice GivenOrEstimated(const Choice& given, const Choice& refined, const LocalizerOptions& options) {
  const bool has_pose = HasPose(given, options);
  const IntrinsicsOrigin origin = IntrinsicsOf(given).origin;
  const bool is_unobservable = refined.failure && refined.failure->cause == QueryStatus::UNKNOWN_CAMERA;
  // A pose with a guess that the images do not judge says nothing, unless a measured position is part of it.
  const bool says_something = has_pose && given.priors.front().position && !is_unobservable;
  if (origin == IntrinsicsOrigin::GUESS && !says_something) return refined;
  if (refined.failure) {
    // A contradiction that comes from telling focal length and distance apart is none if the images cannot.
    return is_unobservable && AreContradicted(given, options) ? KeepGiven(given, IntrinsicsOf(given), options) : given;
  }
  // A pose that would be refused does not speak against one that is more probable, because some focal length fits false
  // matches.
  if (has_pose && ConfidenceOf(refined) < std::min(ConfidenceOf(given), options.min_confidence)) return given;
  const IntrinsicsResult& estimate = IntrinsicsOf(refined);
  const bool is_wrong = Judge(estimate, options).wrong_probability > 0.5;
  if (!AreFixed(origin)) return has_pose && !is_wrong ? KeepGiven(given, estimate, options) : refined;
  // Contradicted intrinsics that somebody has stated are for them to mend.
  return is_wrong || !estimate.contradiction.empty() ? ContradictGiven(given, estimate)
                                                     : KeepGiven(given, estimate, options);
}

}  // namespace

Choice::Choice(const Solution& solved)
    : solution(&solved), failure(solved.failure), priors(solved.priors), intrinsics(solved.checked.results) {}

void Choices::Add(const Solution& next) {
  last = &next;
  if (next.hypothesis.estimates_focal_length) {
    estimated = Choice(next);
  } else {
    given = given ? BetterGiven(*std::move(given), next) : Choice(next);
  }
}

Choice Choose(const Choices& choices, const LocalizerOptions& options) {
  const std::optional<Choice>&given = choices.given, &estimated = choices.estimated;
  if (!given || !estimated) return given ? *given : *estimated;
  Choice choice = GivenOrEstimated(*given, *estimated, options);
  const Solution* other = choice.solution == given->solution ? estimated->solution : given->solution;
  if (!other->evidence.empty()) choice.runner_up = other;
  return choice;
}

std::optional<Refusal> RefusalOf(const Choice& choice, int query, const LocalizerOptions& options) {
  const Solution& solution = *choice.solution;
  const int frame = solution.prepared->group.images[query].frame;
  if (choice.failure) return Refusal{choice.failure->cause, choice.failure->ReasonOf(frame)};
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
  const std::optional<Failure>& failure = choice.failure;
  std::vector<int> frames;
  if (failure && !failure->frames.empty()) return failure->frames;
  for (int frame = 0; frame < static_cast<int>(prepared.group.frame_names.size()); ++frame) {
    if (failure || RefusedIntrinsics(choice, frame, options) != nullptr) {
      frames.push_back(frame);
    }
  }
  return frames;
}

bool IsPositionOpen(const Choice& choice) {
  if (!choice.failure || !choice.solution->refined) return false;
  const QueryStatus cause = choice.failure->cause;
  return cause == QueryStatus::SCALE_UNOBSERVABLE || cause == QueryStatus::DEGENERATE_BASELINE;
}

bool IsRefused(const Choice& choice, const LocalizerOptions& options) {
  return !HasPose(choice, options) || ConfidenceOf(choice) < options.min_confidence;
}

bool IsFocalLengthUncertain(const Choice& given, const LocalizerOptions& options) {
  const IntrinsicsResult& intrinsics = IntrinsicsOf(given);
  if (AreContradicted(given, options)) return true;
  if (given.failure) return !AreFixed(intrinsics.origin);
  // A camera of several database images is probably the photo's own, and no contradiction is left here. If the images
  // tell little of the focal length, as photos of level ground from above, a wrong one may fit as well.
  if (intrinsics.origin == IntrinsicsOrigin::SHARED && !IsRefused(given, options)) return false;
  return !(LogFocalStddev(intrinsics) <= kMaxConclusiveStddev) ||
         Judge(intrinsics, options).wrong_probability > kMinWrongProbability;
}

}  // namespace lazyloc

#include "colmap_lazyloc/pipeline/hypotheses.h"

#include "colmap_lazyloc/intrinsics/focal_length.h"
#include "colmap_lazyloc/pipeline/choose.h"

namespace lazyloc {
namespace {

bool FailsBy(const Choice& choice, QueryStatus cause) { return choice.failure && choice.failure->cause == cause; }

// Returns the bearing of a query whose position is unobservable; null without any.
const Bearing* BearingOf(const Choice& choice) {
  if (!choice.failure || choice.failure->partial_poses.empty()) return nullptr;
  const PartialPose& partial = choice.failure->partial_poses.begin()->second;
  return partial.bearing ? &*partial.bearing : nullptr;
}

bool HasUntestedPosition(const Choice& choice) {
  const std::optional<PriorResult>& position = choice.priors.front().position;
  return position && position->verdict == PriorVerdict::NOT_TESTED;
}

// Returns true if the images give a rotation and nothing of the position, which a prior gives.
bool IsPositionLeftToPrior(const Choice& choice) {
  return FailsBy(choice, QueryStatus::DEGENERATE_BASELINE) && !choice.failure->partial_poses.empty() &&
         BearingOf(choice) == nullptr && HasUntestedPosition(choice);
}

// Returns true if all database images are at one place, and a prior may give the distance from there.
bool IsDistanceLeftToPrior(const Choice& choice) {
  return FailsBy(choice, QueryStatus::SCALE_UNOBSERVABLE) && BearingOf(choice) != nullptr &&
         choice.solution->prepared->group.images.front().problem.pairs.size() > 1 && HasUntestedPosition(choice);
}

// Returns the hypothesis after a solution with given intrinsics. given: the choice among those so far.
std::optional<Hypothesis> AfterGiven(const Solution& last, const Choice& given, const LocalizerOptions& options) {
  const LocalizationProblem& problem = last.prepared->group.images.front().problem;
  const bool can_estimate = options.intrinsics == IntrinsicsMode::AUTO && HasFocalLength(problem.query_camera) &&
                            problem.intrinsics_origin != IntrinsicsOrigin::MODEL &&
                            IsOfThisCamera(problem.intrinsics_origin);
  const bool has_tried_prior = last.hypothesis.approach == Approach::POSITION_PRIOR;
  Hypothesis next;
  next.only_database_image = last.hypothesis.only_database_image;
  if (last.other_orientation) {
    next.approach = Approach::OTHER_ORIENTATION;
  } else if (problem.prior.position && !has_tried_prior && IsPositionOpen(given)) {
    next.approach = Approach::POSITION_PRIOR;
  } else if (IsPositionLeftToPrior(given)) {
    next.approach = Approach::ROTATION;
  } else if (IsDistanceLeftToPrior(given)) {
    // Takes the one image with the best bearing, because images of one place do not triangulate points.
    next.only_database_image = BearingOf(given)->database_name;
  } else if (can_estimate && IsFocalLengthUncertain(given, options)) {
    next.estimates_focal_length = true;
  } else {
    return std::nullopt;
  }
  return next;
}

}  // namespace

std::optional<Hypothesis> NextHypothesis(const QueryGroup& group, const Choices& choices,
                                         const LocalizerOptions& options) {
  const bool is_single = group.images.size() == 1;
  const bool is_paper = options.method == Method::PAPER;
  if (choices.last == nullptr) {
    Hypothesis first;
    if (is_paper) first.approach = Approach::PAPER;
    first.estimates_focal_length =
        is_single && !is_paper && IsFocalLengthUnknown(group.images.front().problem, options);
    return first;
  }
  if (!is_single || is_paper) return std::nullopt;
  const Solution& last = *choices.last;
  if (last.hypothesis.estimates_focal_length) {
    // Tries the stated value too, because the scene may fix the pose even if it does not fix the focal length.
    const bool may_be_stated = !choices.given && options.intrinsics != IntrinsicsMode::REFINE;
    return may_be_stated && IsRefused(*choices.estimated, options) ? std::make_optional(Hypothesis()) : std::nullopt;
  }
  return last.hypothesis.approach == Approach::ROTATION ? std::nullopt : AfterGiven(last, *choices.given, options);
}

}  // namespace lazyloc

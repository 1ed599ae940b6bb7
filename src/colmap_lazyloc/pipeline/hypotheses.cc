#include "colmap_lazyloc/pipeline/hypotheses.h"

#include "colmap_lazyloc/intrinsics/focal_length.h"
#include "colmap_lazyloc/pipeline/choose.h"

namespace lazyloc {
namespace {

bool FailsBy(const Solution& solution, QueryStatus cause) {
  return solution.failure && solution.failure->cause == cause;
}

// Returns the bearing of a query whose position is unobservable; null without any.
const Bearing* BearingOf(const Solution& solution) {
  if (!solution.failure || solution.failure->partial_poses.empty()) return nullptr;
  const PartialPose& partial = solution.failure->partial_poses.begin()->second;
  return partial.bearing ? &*partial.bearing : nullptr;
}

bool HasUntestedPosition(const Solution& solution) {
  const std::optional<PriorResult>& position = solution.priors.front().position;
  return position && position->verdict == PriorVerdict::NOT_TESTED;
}

// Returns true if the images give a rotation and nothing of the position, which a prior gives.
bool IsPositionLeftToPrior(const Solution& solution) {
  return FailsBy(solution, QueryStatus::DEGENERATE_BASELINE) && !solution.failure->partial_poses.empty() &&
         BearingOf(solution) == nullptr && HasUntestedPosition(solution);
}

// Returns true if all database images are at one place, and a prior may give the distance from there.
bool IsDistanceLeftToPrior(const Solution& solution) {
  return FailsBy(solution, QueryStatus::SCALE_UNOBSERVABLE) && BearingOf(solution) != nullptr &&
         solution.prepared->group.images.front().problem.pairs.size() > 1 && HasUntestedPosition(solution);
}

// Returns the hypothesis after a solution with given intrinsics.
std::optional<Hypothesis> AfterGiven(const Solution& given, const LocalizerOptions& options) {
  const LocalizationProblem& problem = given.prepared->group.images.front().problem;
  const bool can_estimate = options.intrinsics == IntrinsicsMode::AUTO && HasFocalLength(problem.query_camera) &&
                            problem.intrinsics_origin != IntrinsicsOrigin::MODEL &&
                            IsOfThisCamera(problem.intrinsics_origin);
  Hypothesis next = given.hypothesis;
  if (IsPositionLeftToPrior(given)) {
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

std::optional<Hypothesis> NextHypothesis(const QueryGroup& group, const std::vector<Solution>& solutions,
                                         const LocalizerOptions& options) {
  const bool is_single = group.images.size() == 1;
  const bool is_paper = options.method == Method::PAPER;
  if (solutions.empty()) {
    Hypothesis first;
    if (is_paper) first.approach = Approach::PAPER;
    first.estimates_focal_length =
        is_single && !is_paper && IsFocalLengthUnknown(group.images.front().problem, options);
    return first;
  }
  if (!is_single || is_paper) return std::nullopt;
  const Solution& last = solutions.back();
  if (last.hypothesis.estimates_focal_length) {
    // Tries the stated value too, because the scene may fix the pose even if it does not fix the focal length.
    const bool may_be_stated = solutions.size() == 1 && options.intrinsics != IntrinsicsMode::REFINE;
    return may_be_stated && IsRefused(last, options) ? std::make_optional(Hypothesis()) : std::nullopt;
  }
  return last.hypothesis.approach == Approach::ROTATION ? std::nullopt : AfterGiven(last, options);
}

}  // namespace lazyloc

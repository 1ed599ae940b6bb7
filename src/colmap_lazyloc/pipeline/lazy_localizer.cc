#include "colmap_lazyloc/pipeline/lazy_localizer.h"

#include "colmap_lazyloc/pipeline/ablations.h"
#include "colmap_lazyloc/pipeline/focal_length.h"
#include "colmap_lazyloc/pipeline/motion_averaging.h"
#include "colmap_lazyloc/pipeline/pose_uncertainty.h"
#include "colmap_lazyloc/pipeline/post_optimization.h"
#include "colmap_lazyloc/pipeline/report.h"
#include "colmap_lazyloc/pipeline/start_selection.h"
#include "colmap_lazyloc/pipeline/track_collection.h"
#include "colmap_lazyloc/scene/stage_timer.h"

namespace lazyloc {
namespace {

void CheckInput(const LocalizationProblem& problem) {
  if (problem.query_keypoints.empty()) throw QueryFailure{QueryStatus::NO_FEATURES, "the query has no keypoints"};
  if (problem.pairs.empty()) {
    throw QueryFailure{QueryStatus::NO_PAIRS, "no posed database image shares matches with the query"};
  }
}

}  // namespace

LocalizationResult LocalizeQuery(const LocalizationProblem& problem, const LocalizerOptions& options) {
  QueryState state(problem, options);
  const auto stage = [&](const char* name, void (*run)(QueryState*)) {
    const StageTimer timer(name, &state.result.seconds);
    run(&state);
  };
  try {
    CheckInput(problem);
    const bool seeks_focal_length = state.SeeksFocalLength();
    stage("two_view", seeks_focal_length ? CollectInlierMatches : FindRelativePoses);
    stage("observations", ObserveMatches);
    if (!seeks_focal_length) {
      try {
        stage("rotation", AverageRotation);
        stage("directions", EstimateDirections);
        stage("translation", AverageTranslation);
      } catch (const QueryFailure& failure) {
        if (failure.status == QueryStatus::SCALE_UNOBSERVABLE) throw;  // by whatever start
        state.averaging_failure = failure;
      }
    }
    if (options.post_optimization == PostOptimization::TRACKS) {
      stage("tracks", CollectTracks);
      stage("start", seeks_focal_length ? ChooseFocalLengthAndPose : ChooseStartPose);
      OptimizeOverTracks(&state);
      stage("covariance", EstimateCovariance);
    } else {
      stage("refinement", RefineWithoutTracks);
    }
    Report(&state);
    state.result.status = QueryStatus::LOCALIZED;
  } catch (const QueryFailure& failure) {
    state.result.status = failure.status;
    state.result.reason = failure.reason;
  }
  return std::move(state.result);
}

}  // namespace lazyloc

#include "colmap_lazyloc/pipeline/lazy_localizer.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <set>

#include "colmap_lazyloc/math/median.h"
#include "colmap_lazyloc/pipeline/ablations.h"
#include "colmap_lazyloc/pipeline/focal_length.h"
#include "colmap_lazyloc/pipeline/motion_averaging.h"
#include "colmap_lazyloc/pipeline/pose_uncertainty.h"
#include "colmap_lazyloc/pipeline/post_optimization.h"
#include "colmap_lazyloc/pipeline/report.h"
#include "colmap_lazyloc/pipeline/start_selection.h"
#include "colmap_lazyloc/pipeline/track_collection.h"

namespace lazyloc {
namespace {

void CheckInput(const QueryState& state) {
  std::vector<bool> has_keypoints(state.NumQueries(), false), has_pairs(state.NumQueries(), false);
  for (int query = 0; query < state.NumQueries(); ++query) {
    if (!state.Problem(query).query_keypoints.empty()) has_keypoints[state.FrameOf(query)] = true;
    if (!state.Problem(query).pairs.empty()) has_pairs[state.FrameOf(query)] = true;
  }
  for (const QueryPair& pair : state.group.query_pairs) {
    // Another frame may stand between it and the database.
    if (state.frames.size() > 1) has_pairs[state.FrameOf(pair.query)] = has_pairs[state.FrameOf(pair.other)] = true;
  }
  using Reason = std::optional<std::string>;
  CheckFrames(state, QueryStatus::NO_FEATURES,
              [&](int frame) { return has_keypoints[frame] ? Reason() : Reason("the query has no keypoints"); });
  CheckFrames(state, QueryStatus::NO_PAIRS, [&](int frame) {
    return has_pairs[frame] ? Reason() : Reason("no posed database image shares matches with the query");
  });
}

// A single frame can do without motion averaging, by another start.
bool CanGoOn(const QueryFailure& failure, const QueryState& state) {
  return state.frames.size() == 1 && failure.status != QueryStatus::SCALE_UNOBSERVABLE &&
         failure.status != QueryStatus::INCONSISTENT_RIG;
}

// Throws QueryFailure where not all frames can be localized.
void Localize(QueryState* state) {
  const auto stage = [&](const char* name, void (*run)(QueryState*)) {
    const StageTimer timer(name, &state->seconds);
    run(state);
  };
  CheckInput(*state);
  const bool seeks_focal_length = state->SeeksFocalLength();
  stage("two_view", seeks_focal_length ? CollectInlierMatches : FindRelativePoses);
  stage("observations", ObserveMatches);
  if (!seeks_focal_length) {
    try {
      stage("rotation", AverageRotation);
      stage("directions", EstimateDirections);
      stage("translation", AverageTranslation);
    } catch (const QueryFailure& failure) {
      if (!CanGoOn(failure, *state)) throw;
      state->averaging_failure = failure;
    }
  }
  if (state->options.post_optimization == PostOptimization::TRACKS) {
    stage("tracks", CollectTracks);
    stage("start", seeks_focal_length ? ChooseFocalLengthAndPose : ChooseStartPose);
    OptimizeOverTracks(state);
    stage("covariance", EstimateCovariance);
  } else {
    stage("refinement", RefineWithoutTracks);
  }
  Report(state);
}

// The images of a group that belong to a part. A single image of a frame is a lone one.
QueryGroup Part(const QueryGroup& group, const std::vector<int>& part_of_image, int part) {
  QueryGroup chosen;
  chosen.has_rig_scale = group.has_rig_scale;
  std::vector<int> new_index(group.images.size(), -1), num_images;
  int last_frame = -1;
  for (size_t i = 0; i < group.images.size(); ++i) {
    if (part_of_image[i] != part) continue;
    const int frame = group.images[i].frame;
    if (frame != last_frame) {
      chosen.frame_names.push_back(group.frame_names[frame]);
      num_images.push_back(0);
      last_frame = frame;
    }
    new_index[i] = static_cast<int>(chosen.images.size());
    chosen.images.push_back(group.images[i]);
    chosen.images.back().frame = static_cast<int>(num_images.size()) - 1;
    ++num_images.back();
  }
  for (QueryImage& image : chosen.images) {
    if (num_images[image.frame] > 1) continue;
    image.cam_from_rig = Rigid3d();
    chosen.frame_names[image.frame].clear();
  }
  for (const QueryPair& pair : group.query_pairs) {
    if (part_of_image[pair.query] != part || part_of_image[pair.other] != part) continue;
    chosen.query_pairs.push_back({new_index[pair.query], new_index[pair.other], pair.images});
  }
  return chosen;
}

std::vector<LocalizationResult> LocalizeInParts(const QueryGroup& group, const std::vector<int>& part_of_member,
                                                const LocalizerOptions& options) {
  std::vector<LocalizationResult> results(group.images.size());
  for (const int part : std::set<int>(part_of_member.begin(), part_of_member.end())) {
    std::vector<LocalizationResult> part_results = LocalizeGroup(Part(group, part_of_member, part), options);
    auto next = part_results.begin();
    for (size_t i = 0; i < results.size(); ++i) {
      if (part_of_member[i] == part) results[i] = std::move(*next++);
    }
  }
  return results;
}

// By member: -1 for those that stay together, the number of the failed frame for the others.
std::vector<int> WithoutFailed(const QueryGroup& group, const std::vector<int>& failed_frames) {
  std::vector<int> part_of_member;
  for (const QueryImage& member : group.images) {
    const bool has_failed = std::count(failed_frames.begin(), failed_frames.end(), member.frame) > 0;
    part_of_member.push_back(has_failed ? member.frame : -1);
  }
  return part_of_member;
}

// By member: -1 for those that can be localized together, its own number for each of the others.
std::vector<int> WithoutLone(const QueryGroup& group, const LocalizerOptions& options) {
  std::vector<int> num_images(group.images.size(), 0);
  for (const QueryImage& member : group.images) ++num_images[member.frame];
  std::vector<int> part_of_member;
  for (int i = 0; i < static_cast<int>(group.images.size()); ++i) {
    const QueryImage& member = group.images[i];
    const bool is_alone = options.post_optimization != PostOptimization::TRACKS ||
                          (num_images[member.frame] == 1 && SeeksFocalLength(member.problem, options));
    part_of_member.push_back(is_alone ? i : -1);
  }
  return part_of_member;
}

std::vector<LocalizationResult> LocalizeTogether(const QueryGroup& group, const LocalizerOptions& options) {
  QueryState state(group, options);
  QueryFailure outcome{QueryStatus::LOCALIZED, ""};
  try {
    Localize(&state);
  } catch (const QueryFailure& failure) {
    outcome = failure;
  }
  if (outcome.status != QueryStatus::LOCALIZED && state.frames.size() > 1) {
    std::vector<int> failed_frames;
    for (const int view : outcome.frames.empty() ? state.frames : outcome.frames) {
      failed_frames.push_back(group.images[view].frame);
    }
    return LocalizeInParts(group, WithoutFailed(group, failed_frames), options);
  }
  for (LocalizationResult& result : state.results) {
    result.status = outcome.status;
    result.reason = outcome.reason;
    for (const auto& [stage, seconds] : state.seconds) {
      result.seconds.emplace_back(stage, seconds / state.NumQueries());
    }
  }
  return std::move(state.results);
}

// Each member by itself.
std::vector<LocalizationResult> LocalizeAlone(const QueryGroup& group, const LocalizerOptions& options) {
  std::vector<int> part_of_member(group.images.size());
  std::iota(part_of_member.begin(), part_of_member.end(), 0);
  return LocalizeInParts(group, part_of_member, options);
}

// The scale of a frame by what its images give when each is localized alone: the median over pairs of images of the
// ratio of their distances. None where there are no two places.
std::optional<double> ScaleOf(int frame, const QueryGroup& group, const std::vector<LocalizationResult>& alone) {
  std::vector<double> ratios;
  for (size_t i = 0; i < alone.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      if (group.images[i].frame != frame || group.images[j].frame != frame) continue;
      if (alone[i].status != QueryStatus::LOCALIZED || alone[j].status != QueryStatus::LOCALIZED) continue;
      const auto distance = [](const Rigid3d& a, const Rigid3d& b) { return (CamInWorld(a) - CamInWorld(b)).norm(); };
      const double given = distance(group.images[i].cam_from_rig, group.images[j].cam_from_rig);
      if (given > 0) ratios.push_back(distance(alone[i].cam_from_world, alone[j].cam_from_world) / given);
    }
  }
  if (ratios.empty()) return std::nullopt;
  const double scale = Median(std::move(ratios));
  return scale > 0 ? std::make_optional(scale) : std::nullopt;
}

// Starts from the scale that the images give one by one; where they give none, their own results stand.
std::vector<LocalizationResult> LocalizeWithoutScale(QueryGroup group, const LocalizerOptions& options) {
  std::vector<LocalizationResult> alone = LocalizeAlone(group, options);
  std::map<int, double> scale_of_frame;
  for (const QueryImage& member : group.images) {
    if (scale_of_frame.count(member.frame) == 0) {
      const std::optional<double> scale = ScaleOf(member.frame, group, alone);
      if (!scale) return alone;
      scale_of_frame[member.frame] = *scale;
    }
  }
  for (QueryImage& member : group.images) member.cam_from_rig.translation *= scale_of_frame[member.frame];
  std::vector<LocalizationResult> results = LocalizeTogether(group, options);
  for (size_t i = 0; i < results.size(); ++i) {
    results[i].rig_scale *= scale_of_frame[group.images[i].frame];
    results[i].seconds.insert(results[i].seconds.end(), alone[i].seconds.begin(), alone[i].seconds.end());
  }
  return results;
}

}  // namespace

std::vector<LocalizationResult> LocalizeGroup(const QueryGroup& group, const LocalizerOptions& options) {
  if (group.images.size() > 1) {
    const std::vector<int> part_of_member = WithoutLone(group, options);
    const bool are_together = std::count(part_of_member.begin(), part_of_member.end(), -1) ==
                              static_cast<std::ptrdiff_t>(part_of_member.size());
    if (!are_together) return LocalizeInParts(group, part_of_member, options);
    if (!group.has_rig_scale) return LocalizeWithoutScale(group, options);
  }
  return LocalizeTogether(group, options);
}

LocalizationResult LocalizeQuery(const LocalizationProblem& problem, const LocalizerOptions& options) {
  QueryGroup group;
  group.frame_names = {""};
  group.images.push_back({problem, 0, {}});
  return std::move(LocalizeGroup(group, options).front());
}

}  // namespace lazyloc

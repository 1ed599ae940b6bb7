#include "colmap_lazyloc/pipeline/focal_length.h"

#include <algorithm>
#include <cmath>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/math/seed.h"
#include "colmap_lazyloc/pipeline/motion_averaging.h"
#include "colmap_lazyloc/pipeline/start_selection.h"

namespace lazyloc {
namespace {

constexpr double kMaxFocalFactor = 3;
// Factors on each side of 1; neighbours differ by 8 %, which adjustment corrects.
constexpr int kNumSteps = 14;

}  // namespace

void CollectInlierMatches(QueryState* state) {
  const LocalizationProblem& problem = state->Problem(0);
  for (size_t i = 0; i < problem.pairs.size(); ++i) {
    const ImagePair& pair = problem.pairs[i];
    const uint32_t seed = SeedFromNames(problem.query_name, pair.other_name, state->options.seed);
    Matches matches = FindInlierMatches(problem, pair, state->options.relative_pose, seed);
    if (matches.empty()) continue;
    state->results[0].pairs[i].num_inliers = static_cast<int>(matches.size());
    state->pairs.push_back({0, state->pair_views[0][i], static_cast<int>(i), {{}, std::move(matches)}, {}, {}});
  }
  KeepBestPairs(state);
  CheckLinks(*state);
}

void ChooseFocalLengthAndPose(QueryState* state) {
  state->tracks_from_database = TriangulateFromDatabase(state->views, state->start_candidates,
                                                        state->options.triangulation, &state->tracks_with_query);
  const double max_error_px = state->options.max_start_error_sigma * state->options.start_noise_px;
  const uint32_t seed = SeedFromNames(state->Problem(0).query_name, "", state->options.seed);
  const double num_tracks = static_cast<double>(std::max<size_t>(state->tracks_from_database.size(), 1));
  const std::vector<Track> no_other_tracks;  // they have no say: any focal length fits an epipolar line
  double best_score = 0, best_factor = 1;
  for (int i = 0; i <= 2 * kNumSteps; ++i) {
    const int step = i % 2 == 0 ? i / 2 : -(i + 1) / 2;  // from the given focal length outwards
    const double factor = std::pow(kMaxFocalFactor, static_cast<double>(step) / kNumSteps);
    const std::vector<Track> tracks =
        state->ObservedBy(WithFocalFactor(state->query_cameras[0], factor), state->tracks_from_database);
    // One with half the inliers of the best so far does not win: RANSAC need not search for it.
    const double min_inlier_ratio = std::max(0.1, 0.5 * best_score / num_tracks);
    const StartEvidence evidence{state->views, tracks, no_other_tracks, max_error_px, min_inlier_ratio};
    const std::optional<Rigid3d> pose = AbsolutePoseStart(evidence, seed);
    if (!pose) continue;
    const double score = ScoreStart(evidence, *pose);
    if (score <= best_score) continue;
    best_score = score;
    best_factor = factor;
    state->views[0].cam_from_world = *pose;
  }
  if (best_score == 0) {
    throw QueryFailure{QueryStatus::TOO_FEW_TRACKS, "no focal length explains the " +
                                                        std::to_string(state->tracks_from_database.size()) +
                                                        " points that two or more database images triangulate"};
  }
  state->results[0].start = EnumName(StartPose::ABSOLUTE_POSE);
  state->ScaleFocalLength(best_factor);
}

}  // namespace lazyloc

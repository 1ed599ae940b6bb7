#include "colmap_lazyloc/pipeline/start_selection.h"

#include <algorithm>
#include <cmath>

#include "colmap_lazyloc/bridge/absolute_pose.h"
#include "colmap_lazyloc/bridge/generalized_relative_pose.h"
#include "colmap_lazyloc/math/seed.h"

namespace lazyloc {
namespace {

// With fewer points that the database triangulates, a generalized relative pose is worth its time.
constexpr size_t kFewTracks = 30;
// A pose that motion averaging has not confirmed must score more than chance gives a pose of wrong matches.
constexpr double kMinUnconfirmedScore = 12;

// Distance of the query's image point from the epipolar line of the track's database view; infinite without baseline.
double EpipolarErrorPx(const Rigid3d& cam_from_world, const View& view, const Track& track) {
  const Observation& query = track.observations.front().observation;
  const Rigid3d& database_pose = view.cam_from_world;
  const Eigen::Vector3d baseline = CamInWorld(cam_from_world) - CamInWorld(database_pose);
  const Eigen::Vector3d database_ray =
      database_pose.rotation.conjugate() * track.observations.back().observation.ray_in_cam;
  const Eigen::Vector3d normal = (cam_from_world.rotation * baseline.cross(database_ray)).normalized();
  return std::abs(normal.dot(query.ray_in_cam)) / RadFromPx(query);
}

double TruncatedScore(double error_px, double max_error_px) {
  const double ratio = error_px / max_error_px;
  return std::max(0.0, 1 - ratio * ratio);
}

double MaxErrorRad(const StartEvidence& evidence, const Track& track) {
  // Half the bound: RANSAC counts all its inliers alike.
  return evidence.max_error_px / 2 * RadFromPx(track.observations.front().observation);
}

}  // namespace

double ScoreStart(const StartEvidence& evidence, const Rigid3d& cam_from_world) {
  double score = 0;
  for (const Track& track : evidence.tracks_from_database) {
    const Observation& observation = track.observations.front().observation;
    const Eigen::Vector3d point_in_cam = cam_from_world * track.point_in_world;
    if (!IsInFront(observation, point_in_cam)) continue;
    score += TruncatedScore(ReprojectionError(observation, point_in_cam).norm(), evidence.max_error_px);
  }
  for (const Track& track : evidence.tracks_with_query) {
    if (track.observations.size() != 2) continue;
    const View& view = evidence.views[track.observations.back().view];
    score += 0.5 * TruncatedScore(EpipolarErrorPx(cam_from_world, view, track), evidence.max_error_px);
  }
  return score;
}

std::optional<Rigid3d> AbsolutePoseStart(const StartEvidence& evidence, uint32_t seed) {
  if (evidence.tracks_from_database.size() < 4) return std::nullopt;
  std::vector<Eigen::Vector3d> rays, points;
  for (const Track& track : evidence.tracks_from_database) {
    rays.push_back(track.observations.front().observation.ray_in_cam);
    points.push_back(track.point_in_world);
  }
  return EstimateAbsolutePose(rays, points, MaxErrorRad(evidence, evidence.tracks_from_database.front()), seed,
                              evidence.min_inlier_ratio);
}

std::optional<Rigid3d> GeneralizedRelativePoseStart(const StartEvidence& evidence, uint32_t seed) {
  std::vector<RayMatch> matches;
  for (const std::vector<Track>* tracks : {&evidence.tracks_from_database, &evidence.tracks_with_query}) {
    for (const Track& track : *tracks) {
      const Eigen::Vector3d& query_ray = track.observations.front().observation.ray_in_cam;
      for (size_t i = 1; i < track.observations.size(); ++i) {
        const TrackObservation& element = track.observations[i];
        matches.push_back({query_ray, element.observation.ray_in_cam, evidence.views[element.view].cam_from_world});
      }
    }
  }
  if (matches.size() < 16) return std::nullopt;
  const std::vector<Track>& any =
      evidence.tracks_from_database.empty() ? evidence.tracks_with_query : evidence.tracks_from_database;
  return EstimateGeneralizedRelativePose(matches, MaxErrorRad(evidence, any.front()), seed);
}

void ChooseStartPose(QueryState* state) {
  const LocalizerOptions& options = state->options;
  state->tracks_from_database =
      TriangulateFromDatabase(state->views, state->start_candidates, options.triangulation, &state->tracks_with_query);
  const StartEvidence evidence{state->views, state->tracks_from_database, state->tracks_with_query,
                               options.max_start_error_sigma * options.start_noise_px};
  const uint32_t seed = SeedFromNames(state->problem.query_name, "", options.seed);
  const Rigid3d averaged = state->views[0].cam_from_world;
  double best_score = -1;
  const auto consider = [&](StartPose kind, const std::optional<Rigid3d>& pose, double min_score) {
    if (!pose) return;
    const double score = ScoreStart(evidence, *pose);
    if (score <= best_score || score < min_score) return;
    best_score = score;
    state->views[0].cam_from_world = *pose;
    state->result.start = kEnumNames<StartPose>[static_cast<size_t>(kind)];
  };
  const auto is_wanted = [&](StartPose kind) {
    return options.start_pose == StartPose::BEST || options.start_pose == kind;
  };
  const double min_score = state->averaging_failure ? kMinUnconfirmedScore : 0;
  if (is_wanted(StartPose::MOTION_AVERAGING) && !state->averaging_failure) {
    consider(StartPose::MOTION_AVERAGING, averaged, 0);
  }
  if (is_wanted(StartPose::ABSOLUTE_POSE)) {
    consider(StartPose::ABSOLUTE_POSE, AbsolutePoseStart(evidence, seed), min_score);
  }
  if (options.start_pose == StartPose::GENERALIZED_RELATIVE_POSE ||
      (options.start_pose == StartPose::BEST && state->tracks_from_database.size() < kFewTracks)) {
    consider(StartPose::GENERALIZED_RELATIVE_POSE, GeneralizedRelativePoseStart(evidence, seed), min_score);
  }
  if (!state->result.start.empty()) return;
  if (state->averaging_failure) throw *state->averaging_failure;
  throw QueryFailure{QueryStatus::TOO_FEW_TRACKS,
                     "no start pose by " + std::string(kEnumNames<StartPose>[static_cast<size_t>(options.start_pose)])};
}

}  // namespace lazyloc

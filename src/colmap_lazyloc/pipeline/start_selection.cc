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

// Of an image of a frame whose reference has the pose.
Rigid3d CamFromWorld(const View& view, const Rigid3d& reference_from_world) {
  return view.rig_link ? view.rig_link->cam_from_reference * reference_from_world : reference_from_world;
}

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

double MaxErrorRad(const StartEvidence& evidence, const Observation& observation) {
  // Half the bound: RANSAC counts all its inliers alike.
  return evidence.max_error_px / 2 * RadFromPx(observation);
}

// Calls visit(track, observation) for the image points of the evidence's frame.
template <typename Visit>
void VisitFrame(const StartEvidence& evidence, const std::vector<Track>& tracks, const Visit& visit) {
  for (const Track& track : tracks) {
    for (const TrackObservation& element : track.observations) {
      if (ReferenceOf(evidence.views, element.view) == evidence.frame) visit(track, element);
    }
  }
}

Rigid3d CamFromReference(const View& view) { return view.rig_link ? view.rig_link->cam_from_reference : Rigid3d(); }

}  // namespace

double ScoreStart(const StartEvidence& evidence, const Rigid3d& reference_from_world) {
  double score = 0;
  VisitFrame(evidence, evidence.tracks_from_database, [&](const Track& track, const TrackObservation& element) {
    const Eigen::Vector3d point_in_cam =
        CamFromWorld(evidence.views[element.view], reference_from_world) * track.point_in_world;
    if (!IsInFront(element.observation, point_in_cam)) return;
    score += TruncatedScore(ReprojectionError(element.observation, point_in_cam).norm(), evidence.max_error_px);
  });
  VisitFrame(evidence, evidence.tracks_with_query, [&](const Track& track, const TrackObservation& element) {
    const View& view = evidence.views[track.observations.back().view];
    if (track.observations.size() != 2 || !view.is_database) return;
    const Rigid3d cam_from_world = CamFromWorld(evidence.views[element.view], reference_from_world);
    const double error_px = EpipolarErrorPx(cam_from_world, view, track);
    score += 0.5 * TruncatedScore(error_px, evidence.max_error_px);
  });
  return score;
}

std::optional<Rigid3d> AbsolutePoseStart(const StartEvidence& evidence, uint32_t seed) {
  std::vector<Eigen::Vector3d> rays, points;
  std::vector<Rigid3d> cams_from_reference;
  double max_error_rad = 0;
  bool is_rig = false;
  VisitFrame(evidence, evidence.tracks_from_database, [&](const Track& track, const TrackObservation& element) {
    if (rays.empty()) max_error_rad = MaxErrorRad(evidence, element.observation);
    const View& view = evidence.views[element.view];
    is_rig = is_rig || view.rig_link;
    rays.push_back(element.observation.ray_in_cam);
    points.push_back(track.point_in_world);
    cams_from_reference.push_back(CamFromReference(view));
  });
  if (rays.size() < 4) return std::nullopt;
  if (is_rig) {
    return EstimateRigAbsolutePose(rays, cams_from_reference, points, max_error_rad, seed, evidence.min_inlier_ratio);
  }
  return EstimateAbsolutePose(rays, points, max_error_rad, seed, evidence.min_inlier_ratio);
}

std::optional<Rigid3d> GeneralizedRelativePoseStart(const StartEvidence& evidence, uint32_t seed) {
  std::vector<RayMatch> matches;
  double max_error_rad = 0;
  for (const std::vector<Track>* tracks : {&evidence.tracks_from_database, &evidence.tracks_with_query}) {
    VisitFrame(evidence, *tracks, [&](const Track& track, const TrackObservation& query) {
      if (max_error_rad == 0) max_error_rad = MaxErrorRad(evidence, query.observation);
      for (const TrackObservation& element : track.observations) {
        const View& view = evidence.views[element.view];
        if (!view.is_database) continue;
        matches.push_back({query.observation.ray_in_cam, element.observation.ray_in_cam, view.cam_from_world,
                           CamFromReference(evidence.views[query.view])});
      }
    });
  }
  if (matches.size() < 16) return std::nullopt;
  return EstimateGeneralizedRelativePose(matches, max_error_rad, seed);
}

namespace {

void ChooseStartPose(const StartEvidence& evidence, QueryState* state) {
  const LocalizerOptions& options = state->options;
  const int frame = evidence.frame;
  const uint32_t seed = SeedFromNames(state->Problem(frame).query_name, "", options.seed);
  const Rigid3d averaged = state->views[frame].cam_from_world;
  std::string start;
  double best_score = -1;
  const auto consider = [&](StartPose kind, const std::optional<Rigid3d>& pose, double min_score) {
    if (!pose) return;
    const double score = ScoreStart(evidence, *pose);
    if (score <= best_score || score < min_score) return;
    best_score = score;
    state->views[frame].cam_from_world = *pose;
    start = EnumName(kind);
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
      (options.start_pose == StartPose::BEST && evidence.tracks_from_database.size() < kFewTracks)) {
    consider(StartPose::GENERALIZED_RELATIVE_POSE, GeneralizedRelativePoseStart(evidence, seed), min_score);
  }
  for (int query = frame; query < state->NumQueries() && state->FrameOf(query) == frame; ++query) {
    state->results[query].start = start;
  }
  if (!start.empty()) return;
  if (state->averaging_failure) throw *state->averaging_failure;
  throw QueryFailure{
      QueryStatus::TOO_FEW_TRACKS, "no start pose by " + std::string(EnumName(options.start_pose)), {frame}};
}

}  // namespace

void ChooseStartPose(QueryState* state) {
  const LocalizerOptions& options = state->options;
  state->tracks_from_database =
      TriangulateFromDatabase(state->views, state->start_candidates, options.triangulation, &state->tracks_with_query);
  const auto from_database = state->TracksByFrame(state->tracks_from_database),
             with_query = state->TracksByFrame(state->tracks_with_query);
  for (const int frame : state->frames) {
    StartEvidence evidence{state->views, from_database[frame], with_query[frame],
                           options.max_start_error_sigma * options.start_noise_px};
    evidence.frame = frame;
    ChooseStartPose(evidence, state);
  }
  FollowReferences(&state->views);
}

}  // namespace lazyloc

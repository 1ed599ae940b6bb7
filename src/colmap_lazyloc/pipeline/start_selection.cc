#include "colmap_lazyloc/pipeline/start_selection.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "colmap_lazyloc/bridge/absolute_pose.h"
#include "colmap_lazyloc/bridge/generalized_relative_pose.h"
#include "colmap_lazyloc/math/seed.h"

namespace lazyloc {
namespace {

// Minimum number of tracks from the database with which a generalized relative pose is not worth its time.
constexpr size_t kFewTracks = 30;
// Minimum score of a pose that motion averaging has not confirmed: more than chance gives a pose of wrong matches.
constexpr double kMinUnconfirmedScore = 12;

// Returns the distance of the query's keypoint from the epipolar line of the track's database observation; infinite
// without baseline.
double EpipolarErrorPx(const Rigid3d& cam_from_world, const Rigid3d& database_from_world, const Track& track) {
  const Observation& query = track.observations.front().observation;
  const Eigen::Vector3d baseline = CamInWorld(cam_from_world) - CamInWorld(database_from_world);
  const Eigen::Vector3d database_ray =
      database_from_world.rotation.conjugate() * track.observations.back().observation.ray_in_cam;
  const Eigen::Vector3d normal = (cam_from_world.rotation * baseline.cross(database_ray)).normalized();
  return std::abs(normal.dot(query.ray_in_cam)) / RadFromPx(query);
}

double TruncatedScore(double error_px, double max_error_px) {
  const double ratio = error_px / max_error_px;
  return std::max(0.0, 1 - ratio * ratio);
}

double MaxErrorRad(const StartEvidence& evidence, const Observation& observation) {
  // Takes half the bound, because RANSAC counts all its inliers alike.
  return evidence.max_error_px / 2 * RadFromPx(observation);
}

// Calls visit(track, observation) for the observations in the evidence's frame.
template <typename Visit>
void VisitFrame(const StartEvidence& evidence, const TrackRefs& tracks, const Visit& visit) {
  for (const Track* track : tracks) {
    for (const TrackObservation& element : track->observations) {
      if (evidence.posed.images[element.image].frame == evidence.frame) visit(*track, element);
    }
  }
}

}  // namespace

double ScoreStart(const StartEvidence& evidence, const Rigid3d& frame_from_world) {
  const auto pose_of = [&](int image) { return CamFromWorld(evidence.posed.images[image], frame_from_world); };
  double score = 0;
  VisitFrame(evidence, evidence.from_database, [&](const Track& track, const TrackObservation& element) {
    const Eigen::Vector3d point_in_cam = pose_of(element.image) * track.point_in_world;
    if (!IsInFront(element.observation, point_in_cam)) return;
    score += TruncatedScore(ReprojectionError(element.observation, point_in_cam).norm(), evidence.max_error_px);
  });
  VisitFrame(evidence, evidence.rest, [&](const Track& track, const TrackObservation& element) {
    const int other = track.observations.back().image;
    if (track.observations.size() != 2 || !evidence.posed.IsDatabase(other)) return;
    const double error_px = EpipolarErrorPx(pose_of(element.image), CamFromWorld(evidence.posed, other), track);
    score += 0.5 * TruncatedScore(error_px, evidence.max_error_px);
  });
  return score;
}

std::optional<Rigid3d> AbsolutePoseStart(const StartEvidence& evidence, uint32_t seed) {
  std::vector<Eigen::Vector3d> rays, points;
  std::vector<Rigid3d> cams_from_frame;
  double max_error_rad = 0;
  bool is_rig = false;
  VisitFrame(evidence, evidence.from_database, [&](const Track& track, const TrackObservation& element) {
    if (rays.empty()) max_error_rad = MaxErrorRad(evidence, element.observation);
    const Image& image = evidence.posed.images[element.image];
    is_rig = is_rig || !HasFrameAxes(image);
    rays.push_back(element.observation.ray_in_cam);
    points.push_back(track.point_in_world);
    cams_from_frame.push_back(image.cam_from_frame);
  });
  if (rays.size() < 4) return std::nullopt;
  if (is_rig) {
    return EstimateRigAbsolutePose(rays, cams_from_frame, points, max_error_rad, seed, evidence.min_inlier_ratio);
  }
  return EstimateAbsolutePose(rays, points, max_error_rad, seed, evidence.min_inlier_ratio);
}

std::optional<Rigid3d> GeneralizedRelativePoseStart(const StartEvidence& evidence, uint32_t seed) {
  std::vector<RayMatch> matches;
  double max_error_rad = 0;
  for (const TrackRefs* tracks : {&evidence.from_database, &evidence.rest}) {
    VisitFrame(evidence, *tracks, [&](const Track& track, const TrackObservation& query) {
      if (max_error_rad == 0) max_error_rad = MaxErrorRad(evidence, query.observation);
      for (const TrackObservation& element : track.observations) {
        if (!evidence.posed.IsDatabase(element.image)) continue;
        matches.push_back({query.observation.ray_in_cam, element.observation.ray_in_cam,
                           CamFromWorld(evidence.posed, element.image),
                           evidence.posed.images[query.image].cam_from_frame});
      }
    });
  }
  if (matches.size() < 16) return std::nullopt;
  return EstimateGeneralizedRelativePose(matches, max_error_rad, seed);
}

namespace {

struct FrameStart {
  Rigid3d frame_from_world;
  StartPose kind = StartPose::BEST;
};

// Chooses the hypothesis with the best score for a frame. Throws Failure without any.
FrameStart ChooseFrameStart(const StartEvidence& evidence, const Averaged& averaged, uint32_t seed,
                            const LocalizerOptions& options) {
  std::optional<FrameStart> best;
  double best_score = -1;
  const auto consider = [&](StartPose kind, const std::optional<Rigid3d>& pose, double min_score) {
    if (!pose) return;
    const double score = ScoreStart(evidence, *pose);
    if (score <= best_score || score < min_score) return;
    best_score = score;
    best = FrameStart{*pose, kind};
  };
  const auto is_wanted = [&](StartPose kind) {
    return options.start_pose == StartPose::BEST || options.start_pose == kind;
  };
  const double min_score = averaged.failure ? kMinUnconfirmedScore : 0;
  if (is_wanted(StartPose::MOTION_AVERAGING) && !averaged.failure) {
    consider(StartPose::MOTION_AVERAGING, averaged.posed.frames[evidence.frame].frame_from_world, 0);
  }
  if (is_wanted(StartPose::ABSOLUTE_POSE)) {
    consider(StartPose::ABSOLUTE_POSE, AbsolutePoseStart(evidence, seed), min_score);
  }
  if (options.start_pose == StartPose::GENERALIZED_RELATIVE_POSE ||
      (options.start_pose == StartPose::BEST && evidence.from_database.size() < kFewTracks)) {
    consider(StartPose::GENERALIZED_RELATIVE_POSE, GeneralizedRelativePoseStart(evidence, seed), min_score);
  }
  if (best) return *best;
  if (averaged.failure) throw Failure(*averaged.failure);
  throw Failure{
      QueryStatus::TOO_FEW_TRACKS, "no start pose by " + std::string(EnumName(options.start_pose)), {evidence.frame}};
}

}  // namespace

Start ChooseStart(const Layout& layout, const Averaged& averaged, const SplitTracks& tracks,
                  const LocalizerOptions& options) {
  const std::vector<TrackRefs> from_database = TracksByFrame(layout, tracks.from_database),
                               rest = TracksByFrame(layout, tracks.rest);
  Start start{averaged.posed, {}};
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    StartEvidence evidence{averaged.posed, from_database[frame], rest[frame], kMaxStartErrorPx};
    evidence.frame = frame;
    const uint32_t seed = SeedFromNames(layout.names[layout.QueriesOf(frame).front()], "", options.seed);
    const FrameStart chosen = ChooseFrameStart(evidence, averaged, seed, options);
    start.posed.frames[frame].frame_from_world = chosen.frame_from_world;
    start.kinds.push_back(chosen.kind);
  }
  return start;
}

}  // namespace lazyloc

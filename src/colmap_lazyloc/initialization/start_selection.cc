#include "colmap_lazyloc/initialization/start_selection.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <utility>

#include "colmap_lazyloc/bridge/absolute_pose.h"
#include "colmap_lazyloc/bridge/generalized_relative_pose.h"
#include "colmap_lazyloc/math/seed.h"
#include "colmap_lazyloc/scene/epipolar_error.h"

namespace lazyloc {
namespace {

// Minimum number of tracks from the database with which a generalized relative pose is not worth its time.
constexpr size_t kFewTracks = 30;
// Minimum score of a pose that motion averaging has not confirmed: more than chance gives a pose of wrong matches. Such
// a pose localizes nothing, but its failure says less than that of averaging.
constexpr double kMinUnconfirmedScore = 12;
// Bound on errors of precise matches. The inliers of RANSAC count alike, so that within the wide bound of noisy
// matches, a pose that fits all by several pixels is preferred to one that fits most by one.
constexpr double kPreciseErrorPx = 2;

// Returns the distance of the query's keypoint from the epipolar line of the track's database observation.
double EpipolarErrorPx(const Rigid3d& cam_from_world, const Rigid3d& database_from_world, const Track& track) {
  const auto world_from = [](const Rigid3d& pose) { return pose.rotation.conjugate().toRotationMatrix(); };
  RayMatch match = MakeRayMatch(world_from(database_from_world), track.observations.back().observation,
                                world_from(cam_from_world), track.observations.front().observation);
  match.stddev1_rad = 0;
  return std::abs(SampsonError(match, CamInWorld(cam_from_world) - CamInWorld(database_from_world)));
}

double TruncatedScore(double error_px, double max_error_px) {
  const auto cauchy_loss = [](double px) { return std::log1p(px * px); };
  return std::max(0.0, 1 - cauchy_loss(error_px) / cauchy_loss(max_error_px));
}

// Returns by how many pixels a standard deviation of its depth moves a track's point in the query.
double DepthStddevPx(const PosedImages& posed, const Track& track, const TrackObservation& query,
                     const Rigid3d& cam_from_world) {
  for (const TrackObservation& element : track.observations) {
    const std::optional<DepthScale>& scale = posed.images[element.image].depth_scale;
    if (!scale || !(element.depth > 0)) continue;
    const Eigen::Vector3d centre = CamInWorld(CamFromWorld(posed, element.image));
    const Eigen::Vector3d moved = centre + std::exp(scale->log_depth_stddev) * (track.point_in_world - centre);
    const Eigen::Vector3d before = cam_from_world * track.point_in_world, after = cam_from_world * moved;
    if (!IsInFront(query.observation, before) || !IsInFront(query.observation, after)) return 0;
    return (ReprojectionError(query.observation, after) - ReprojectionError(query.observation, before)).norm();
  }
  return 0;
}

double MaxErrorRad(const StartProblem& problem, const Observation& observation) {
  // Takes half the bound, because RANSAC counts all its inliers alike.
  return problem.max_error_px / 2 * RadFromPx(observation);
}

// Calls visit(track, observation) for the observations in the problem's frame.
template <typename Visit>
void VisitFrame(const StartProblem& problem, const TrackRefs& tracks, const Visit& visit) {
  for (const Track* track : tracks) {
    for (const TrackObservation& element : track->observations) {
      if (problem.posed.images[element.image].frame == problem.frame) visit(*track, element);
    }
  }
}

// Sets the start of the problem's frame to the hypothesis with the best score. Throws Failure without any.
void SetFrameStart(const StartProblem& problem, const Averaged& averaged, uint32_t seed,
                   const std::vector<Rigid3d>& depth_starts, Start* start) {
  const double min_score = averaged.failure ? kMinUnconfirmedScore : 0;
  double best_score = -1;
  const auto consider = [&](StartPose kind, const std::optional<Rigid3d>& pose) {
    if (!pose) return;
    const double score = ScoreStart(problem, *pose);
    if (score <= best_score || score < min_score) return;
    best_score = score;
    start->posed.frames[problem.frame].frame_from_world = *pose;
    start->kinds[problem.frame] = kind;
  };
  if (!averaged.failure) {
    consider(StartPose::MOTION_AVERAGING, averaged.posed.frames[problem.frame].frame_from_world);
  }
  consider(StartPose::ABSOLUTE_POSE, AbsolutePoseStart(problem, seed));
  consider(StartPose::DEPTH, DepthStart(problem, seed));
  for (const Rigid3d& pose : depth_starts) consider(StartPose::DEPTH, pose);
  if (problem.from_database.size() < kFewTracks) {
    for (const double max_error_px : {problem.max_error_px, kPreciseErrorPx}) {
      StartProblem within = problem;
      within.max_error_px = max_error_px;
      consider(StartPose::GENERALIZED_RELATIVE_POSE, GeneralizedRelativePoseStart(within, seed));
    }
  }
  if (best_score >= 0) return;
  if (averaged.failure) throw Failure(*averaged.failure);
  throw Failure{QueryStatus::TOO_FEW_TRACKS, "no start pose", {problem.frame}};
}

// Returns the tracks that have a depth, with the points that the depths state.
std::vector<Track> TracksFromDepth(const PosedImages& posed, const std::vector<Track>& tracks) {
  std::vector<Track> from_depth;
  for (const Track& track : tracks) {
    for (const TrackObservation& element : track.observations) {
      const auto point = PointByDepth(posed.images[element.image], CamFromWorld(posed, element.image), element);
      if (!point) continue;
      from_depth.push_back(track);
      from_depth.back().point_in_world = *point;
      break;
    }
  }
  return from_depth;
}

}  // namespace

double ScoreStart(const StartProblem& problem, const Rigid3d& frame_from_world) {
  const auto pose_of = [&](int image) { return CamFromWorld(problem.posed.images[image], frame_from_world); };
  const auto point_score = [&](const Track& track, const TrackObservation& element, double max_error_px) {
    const Eigen::Vector3d point_in_cam = pose_of(element.image) * track.point_in_world;
    if (!IsInFront(element.observation, point_in_cam)) return 0.0;
    return TruncatedScore(ReprojectionError(element.observation, point_in_cam).norm(), max_error_px);
  };
  double score = 0;
  VisitFrame(problem, problem.from_database, [&](const Track& track, const TrackObservation& element) {
    score += point_score(track, element, problem.max_error_px);
  });
  VisitFrame(problem, problem.rest, [&](const Track& track, const TrackObservation& element) {
    const int other = track.observations.back().image;
    if (track.observations.size() != 2 || !problem.posed.IsDatabase(other)) return;
    const double error_px = EpipolarErrorPx(pose_of(element.image), CamFromWorld(problem.posed, other), track);
    score += 0.5 * TruncatedScore(error_px, problem.max_error_px);
  });
  VisitFrame(problem, problem.from_depth, [&](const Track& track, const TrackObservation& element) {
    const double max_error_px =
        std::hypot(problem.max_error_px,
                   kMaxStartErrorSigma * DepthStddevPx(problem.posed, track, element, pose_of(element.image)));
    score += 0.5 * point_score(track, element, max_error_px);
  });
  return score;
}

std::optional<Rigid3d> AbsolutePoseStart(const StartProblem& problem, uint32_t seed) {
  std::vector<Eigen::Vector3d> rays, points;
  std::vector<Rigid3d> cams_from_frame;
  double max_error_rad = 0;
  bool is_rig = false;
  VisitFrame(problem, problem.from_database, [&](const Track& track, const TrackObservation& element) {
    if (rays.empty()) max_error_rad = MaxErrorRad(problem, element.observation);
    const Image& image = problem.posed.images[element.image];
    is_rig = is_rig || !HasFrameAxes(image);
    rays.push_back(element.observation.ray_in_cam);
    points.push_back(track.point_in_world);
    cams_from_frame.push_back(image.cam_from_frame);
  });
  if (rays.size() < 4) return std::nullopt;
  if (is_rig) {
    return EstimateRigAbsolutePose(rays, cams_from_frame, points, max_error_rad, seed, problem.min_inlier_ratio);
  }
  return EstimateAbsolutePose(rays, points, max_error_rad, seed, problem.min_inlier_ratio);
}

std::optional<Rigid3d> DepthStart(const StartProblem& problem, uint32_t seed) {
  if (problem.from_depth.empty()) return std::nullopt;
  TrackRefs tracks = problem.from_database;
  tracks.insert(tracks.end(), problem.from_depth.begin(), problem.from_depth.end());
  const StartProblem with_depth{problem.posed, tracks, problem.rest, problem.max_error_px, problem.min_inlier_ratio,
                                problem.frame};
  return AbsolutePoseStart(with_depth, seed);
}

std::optional<Rigid3d> GeneralizedRelativePoseStart(const StartProblem& problem, uint32_t seed) {
  std::vector<PosedRayMatch> matches;
  std::set<std::pair<int, int>> image_pairs;
  double max_error_rad = 0;
  for (const TrackRefs* tracks : {&problem.from_database, &problem.rest}) {
    VisitFrame(problem, *tracks, [&](const Track& track, const TrackObservation& query) {
      if (max_error_rad == 0) max_error_rad = MaxErrorRad(problem, query.observation);
      for (const TrackObservation& element : track.observations) {
        if (!problem.posed.IsDatabase(element.image)) continue;
        image_pairs.emplace(query.image, element.image);
        matches.push_back({query.observation.ray_in_cam, element.observation.ray_in_cam,
                           CamFromWorld(problem.posed, element.image),
                           problem.posed.images[query.image].cam_from_frame});
      }
    });
  }
  if (matches.size() < 16 || image_pairs.size() < 2) return std::nullopt;  // one pair tells no distance
  return EstimateGeneralizedRelativePose(matches, max_error_rad, seed);
}

Start ChooseStart(const Layout& layout, const Averaged& averaged, const SplitTracks& tracks,
                  const LocalizerOptions& options, const std::vector<std::vector<Rigid3d>>& depth_starts) {
  const std::vector<TrackRefs> from_database = TracksByFrame(layout, tracks.from_database),
                               rest = TracksByFrame(layout, tracks.rest);
  const std::vector<Track> with_depth = TracksFromDepth(averaged.posed, tracks.rest);
  const std::vector<TrackRefs> from_depth = TracksByFrame(layout, with_depth);
  Start start{averaged.posed, std::vector<StartPose>(layout.num_query_frames)};
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    StartProblem problem{averaged.posed, from_database[frame], rest[frame], kMaxStartErrorPx};
    problem.frame = frame;
    problem.from_depth = from_depth[frame];
    const uint32_t seed = SeedFromNames(layout.names[layout.QueriesOf(frame).front()], "", options.seed);
    SetFrameStart(problem, averaged, seed, depth_starts.empty() ? std::vector<Rigid3d>() : depth_starts[frame], &start);
  }
  return start;
}

}  // namespace lazyloc

#include "colmap_lazyloc/pipeline/rig_check.h"

#include <limits>
#include <utility>

#include "colmap_lazyloc/bridge/absolute_pose.h"
#include "colmap_lazyloc/math/median.h"
#include "colmap_lazyloc/math/seed.h"
#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

using Reason = std::optional<std::string>;

std::string Describe(const QueryState& state, int query) {
  return "image " + state.Problem(query).query_name +
         " does not fit its place in the rig: the rig's calibration (or the trajectory) is wrong; see "
         "--LazyLocalizer.use_rigs 0";
}

// An image point of a query, and its triangulated point.
struct RayToPoint {
  Observation observation;
  Eigen::Vector3d point_in_world;
};

size_t NumFitting(const Rigid3d& cam_from_world, const std::vector<RayToPoint>& rays, double max_error_px) {
  size_t num_fitting = 0;
  for (const auto& [observation, point] : rays) {
    const Eigen::Vector3d point_in_cam = cam_from_world * point;
    num_fitting +=
        IsInFront(observation, point_in_cam) && ReprojectionError(observation, point_in_cam).norm() <= max_error_px;
  }
  return num_fitting;
}

// None without points.
std::optional<double> MedianErrorPx(const Rigid3d& cam_from_world, const std::vector<RayToPoint>& rays) {
  std::vector<double> errors_px;
  for (const auto& [observation, point] : rays) {
    const Eigen::Vector3d point_in_cam = cam_from_world * point;
    errors_px.push_back(IsInFront(observation, point_in_cam) ? ReprojectionError(observation, point_in_cam).norm()
                                                             : std::numeric_limits<double>::infinity());
  }
  if (errors_px.empty()) return std::nullopt;
  return Median(std::move(errors_px));
}

// Whether most of the points fit some pose of the image, and not half as many the pose that its frame gives it.
bool FitsBetterAlone(const QueryState& state, int query, const std::vector<RayToPoint>& rays) {
  if (static_cast<int>(rays.size()) < 2 * state.options.min_num_tracks) return false;
  // What the start takes for a fit, halved: a trajectory may be off by some pixels.
  const double max_error_px = state.options.max_start_error_sigma * state.options.start_noise_px / 2;
  std::vector<Eigen::Vector3d> rays_in_cam, points;
  for (const auto& [observation, point] : rays) {
    rays_in_cam.push_back(observation.ray_in_cam);
    points.push_back(point);
  }
  const uint32_t seed = SeedFromNames(state.Problem(query).query_name, "", state.options.seed);
  const std::optional<Rigid3d> alone =
      EstimateAbsolutePose(rays_in_cam, points, max_error_px / 2 * RadFromPx(rays.front().observation), seed, 0.1);
  if (!alone) return false;
  const size_t num_alone = NumFitting(*alone, rays, max_error_px);
  return 2 * num_alone >= rays.size() &&
         2 * NumFitting(state.views[query].cam_from_world, rays, max_error_px) < num_alone;
}

bool HasSeveralImages(const QueryState& state, int frame) {
  return frame + 1 < state.NumQueries() && state.FrameOf(frame + 1) == frame;
}

}  // namespace

void CheckRigs(QueryState* state) {
  std::vector<std::vector<RayToPoint>> rays(state->NumQueries());
  for (const Track& track : state->tracks_from_database) {
    for (const TrackObservation& element : track.observations) {
      if (state->views[element.view].is_database) continue;
      rays[element.view].push_back({element.observation, track.point_in_world});
    }
  }
  CheckFrames(*state, QueryStatus::INCONSISTENT_RIG, [&](int frame) {
    if (!HasSeveralImages(*state, frame)) return Reason();
    for (int query = frame; query < state->NumQueries() && state->FrameOf(query) == frame; ++query) {
      state->results[query].rig_error_px = MedianErrorPx(state->views[query].cam_from_world, rays[query]);
      if (FitsBetterAlone(*state, query, rays[query])) return Reason(Describe(*state, query));
    }
    return Reason();
  });
}

void CheckRigRotations(const QueryState& state, const std::vector<double>& rotation_errors_rad, double max_error_deg) {
  const double max_error_rad = DegToRad(max_error_deg);
  std::vector<RotationAveragingProblem> alone(state.NumQueries());
  std::vector<size_t> num_agreeing(state.NumQueries(), 0);
  for (RotationAveragingProblem& problem : alone) {
    problem.rotations = {Eigen::Quaterniond::Identity()};
    problem.is_fixed = {false};
  }
  for (size_t i = 0; i < state.pairs.size(); ++i) {
    const PairState& pair = state.pairs[i];
    if (!state.HasDatabaseImage(pair)) continue;
    num_agreeing[pair.query] += rotation_errors_rad[i] <= max_error_rad;
    RotationAveragingProblem& problem = alone[pair.query];
    problem.edges.push_back({static_cast<int>(problem.rotations.size()), 0,
                             pair.relative_pose.query_from_other.rotation,
                             static_cast<double>(pair.relative_pose.inlier_matches.size())});
    problem.rotations.push_back(state.views[pair.view].cam_from_world.rotation);
    problem.is_fixed.push_back(true);
  }
  CheckFrames(state, QueryStatus::INCONSISTENT_RIG, [&](int frame) {
    if (!HasSeveralImages(state, frame)) return Reason();
    for (int query = frame; query < state.NumQueries() && state.FrameOf(query) == frame; ++query) {
      if (num_agreeing[query] > 0 || alone[query].edges.size() < 2) continue;
      const RotationAveragingResult averaged = AverageRotations(alone[query], state.options.rotation_averaging);
      size_t num_agreeing_alone = 0;
      for (const double error_rad : averaged.edge_errors_rad) num_agreeing_alone += error_rad <= max_error_rad;
      if (num_agreeing_alone >= 2 && 2 * num_agreeing_alone > alone[query].edges.size()) {
        return Reason(Describe(state, query));
      }
    }
    return Reason();
  });
}

}  // namespace lazyloc

#include "colmap_lazyloc/pipeline/start_selection.h"

#include <algorithm>

#include "colmap_lazyloc/bridge/absolute_pose.h"
#include "colmap_lazyloc/math/seed.h"

namespace lazyloc {

double ScoreStart(const Rigid3d& cam_from_world, const std::vector<Track>& tracks, double max_error_px) {
  double score = 0;
  for (const Track& track : tracks) {
    const Observation& observation = track.observations.front().observation;
    const Eigen::Vector3d point_in_cam = cam_from_world * track.point_in_world;
    if (!IsInFront(observation, point_in_cam)) continue;
    const double error = ReprojectionError(observation, point_in_cam).norm() / max_error_px;
    score += std::max(0.0, 1 - error * error);
  }
  return score;
}

std::optional<Rigid3d> AbsolutePose(const std::vector<Track>& tracks, double max_error_px, uint32_t seed,
                                    double min_inlier_ratio) {
  if (tracks.size() < 4) return std::nullopt;
  std::vector<Eigen::Vector3d> rays, points;
  for (const Track& track : tracks) {
    rays.push_back(track.observations.front().observation.ray_in_cam);
    points.push_back(track.point_in_world);
  }
  // Half the bound: RANSAC counts all its inliers alike.
  const double max_error_rad = max_error_px / 2 * RadFromPx(tracks.front().observations.front().observation);
  return EstimateAbsolutePose(rays, points, max_error_rad, seed, min_inlier_ratio);
}

Rigid3d ChooseStart(const std::vector<View>& views, const std::vector<Track>& tracks, double max_error_px,
                    uint32_t seed) {
  const Rigid3d& averaged = views.front().cam_from_world;
  const std::optional<Rigid3d> absolute = AbsolutePose(tracks, max_error_px, seed);
  if (!absolute) return averaged;
  return ScoreStart(*absolute, tracks, max_error_px) > ScoreStart(averaged, tracks, max_error_px) ? *absolute
                                                                                                  : averaged;
}

void ChooseStartPose(QueryState* state) {
  state->tracks_from_database = TriangulateFromDatabase(state->views, state->start_candidates,
                                                        state->options.triangulation, &state->tracks_with_query);
  const double max_error_px = state->options.max_start_error_sigma * state->options.start_noise_px;
  const uint32_t seed = SeedFromNames(state->problem.query_name, "", state->options.seed);
  state->views[0].cam_from_world = ChooseStart(state->views, state->tracks_from_database, max_error_px, seed);
}

}  // namespace lazyloc

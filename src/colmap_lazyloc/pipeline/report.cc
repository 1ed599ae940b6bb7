#include "colmap_lazyloc/pipeline/report.h"

#include <algorithm>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

void ReportPairs(QueryState* state) {
  if (state->SeeksFocalLength()) return;  // relative poses had no part in it
  const Rigid3d& query = state->views[0].cam_from_world;
  for (const PairState& pair : state->pairs) {
    const Rigid3d& database = state->DatabaseView(pair).cam_from_world;
    PairResult& report = state->result.pairs[pair.index];
    report.rotation_error_deg = RadToDeg(
        AngularDistanceRad(query.rotation, pair.relative_pose.query_from_database.rotation * database.rotation));
    if (pair.direction.dir_1to2_in_world.isZero()) continue;
    report.direction_error_deg =
        RadToDeg(AngleBetweenRad(pair.direction.dir_1to2_in_world, CamInWorld(query) - CamInWorld(database)));
  }
}

// Errors are those that a reader of the result finds: against the database's poses as they were given.
void ReportTracks(QueryState* state) {
  LocalizationResult* result = &state->result;
  std::vector<Rigid3d> cams_from_world = {state->views[0].cam_from_world};
  for (size_t view = 1; view < state->views.size(); ++view) cams_from_world.push_back(state->GivenPose(view));
  double error_sum = 0;
  for (const Track& track : state->tracks) {
    PointResult point;
    point.point_in_world = track.point_in_world + state->origin;
    double track_error_sum = 0;
    for (const TrackObservation& element : track.observations) {
      const Eigen::Vector3d point_in_cam = cams_from_world[element.view] * track.point_in_world;
      track_error_sum += ReprojectionError(element.observation, point_in_cam).norm();
      if (element.view == 0) {
        point.query_point = element.keypoint;
      } else {
        point.observations.emplace_back(element.view - 1, element.keypoint);
      }
    }
    point.mean_reprojection_error_px = track_error_sum / static_cast<double>(track.observations.size());
    error_sum += track_error_sum;
    result->num_observations += static_cast<int>(track.observations.size());
    result->points.push_back(std::move(point));
  }
  result->num_tracks = static_cast<int>(state->tracks.size());
  result->mean_reprojection_error_px = error_sum / std::max(result->num_observations, 1);
}

}  // namespace

void Report(QueryState* state) {
  const Rigid3d& pose = state->views[0].cam_from_world;
  state->result.cam_from_world = {pose.rotation, pose.translation - pose.rotation * state->origin};
  state->result.query_camera = state->query_camera;
  state->result.is_camera_refined = state->SeeksFocalLength();
  ReportPairs(state);
  ReportTracks(state);
}

}  // namespace lazyloc

#include "colmap_lazyloc/pipeline/report.h"

#include <algorithm>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

void ReportPairs(QueryState* state) {
  if (state->SeeksFocalLength()) return;  // relative poses had no part in it
  for (const PairState& pair : state->pairs) {
    if (!state->HasDatabaseImage(pair)) continue;
    const Rigid3d& query = state->views[pair.query].cam_from_world;
    const Rigid3d& database = state->views[pair.view].cam_from_world;
    PairResult& report = state->results[pair.query].pairs[pair.index];
    report.rotation_error_deg = RadToDeg(
        AngularDistanceRad(query.rotation, pair.relative_pose.query_from_other.rotation * database.rotation));
    if (pair.direction.dir_1to2_in_world.isZero()) continue;
    report.direction_error_deg =
        RadToDeg(AngleBetweenRad(pair.direction.dir_1to2_in_world, CamInWorld(query) - CamInWorld(database)));
  }
}

// A track as one of its queries has it: with the query's own image point and those in its database images.
void ReportTrack(const Track& track, const TrackObservation& query, const std::vector<double>& errors_px,
                 QueryState* state) {
  const std::vector<int>& pair_views = state->pair_views[query.view];
  PointResult point;
  point.observations.reserve(track.observations.size());
  point.point_in_world = track.point_in_world + state->origin;
  point.query_point = query.keypoint;
  double error_sum = 0;
  int num_observations = 0;
  for (size_t i = 0; i < track.observations.size(); ++i) {
    const TrackObservation& element = track.observations[i];
    if (element.view < state->NumQueries() && element.view != query.view) continue;
    error_sum += errors_px[i];
    ++num_observations;
    const auto pair = std::find(pair_views.begin(), pair_views.end(), element.view);
    if (pair != pair_views.end()) {
      point.observations.emplace_back(static_cast<int>(pair - pair_views.begin()), element.keypoint);
    }
  }
  point.mean_reprojection_error_px = error_sum / num_observations;
  LocalizationResult& result = state->results[query.view];
  result.mean_reprojection_error_px += error_sum;  // to be divided
  result.num_observations += num_observations;
  ++result.num_tracks;
  result.points.push_back(std::move(point));
}

// Errors are those that a reader of the result finds: against the database's poses as they were given.
void ReportTracks(QueryState* state) {
  std::vector<Rigid3d> cams_from_world;
  for (size_t view = 0; view < state->views.size(); ++view) {
    cams_from_world.push_back(state->views[view].is_database ? state->GivenPose(view)
                                                             : state->views[view].cam_from_world);
  }
  std::vector<double> errors_px;
  for (const Track& track : state->tracks) {
    errors_px.clear();
    for (const TrackObservation& element : track.observations) {
      const Eigen::Vector3d point_in_cam = cams_from_world[element.view] * track.point_in_world;
      errors_px.push_back(ReprojectionError(element.observation, point_in_cam).norm());
    }
    for (const TrackObservation& element : track.observations) {
      if (element.view < state->NumQueries()) ReportTrack(track, element, errors_px, state);
    }
  }
  for (LocalizationResult& result : state->results) {
    result.mean_reprojection_error_px /= std::max(result.num_observations, 1);
  }
}

}  // namespace

void Report(QueryState* state) {
  for (int query = 0; query < state->NumQueries(); ++query) {
    const Rigid3d& pose = state->views[query].cam_from_world;
    LocalizationResult& result = state->results[query];
    result.cam_from_world = {pose.rotation, pose.translation - pose.rotation * state->origin};
    result.rig_scale = state->RigScale(state->FrameOf(query));
    Rigid3d cam_from_rig = state->group.images[query].cam_from_rig;
    cam_from_rig.translation *= result.rig_scale;
    result.rig_from_world = Inverse(cam_from_rig) * result.cam_from_world;
    result.query_camera = state->query_cameras[query];
    result.is_camera_refined = state->SeeksFocalLength();
  }
  ReportPairs(state);
  ReportTracks(state);
}

}  // namespace lazyloc

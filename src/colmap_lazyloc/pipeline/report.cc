#include "colmap_lazyloc/pipeline/report.h"

#include <algorithm>

namespace lazyloc {

void ReportTracks(const std::vector<View>& views, const std::vector<Track>& tracks, const Eigen::Vector3d& origin,
                  LocalizationResult* result) {
  double error_sum = 0;
  for (const Track& track : tracks) {
    PointResult point;
    point.point_in_world = track.point_in_world + origin;
    double track_error_sum = 0;
    for (const TrackObservation& element : track.observations) {
      const Eigen::Vector3d point_in_cam = views[element.view].cam_from_world * track.point_in_world;
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
  result->num_tracks = static_cast<int>(tracks.size());
  result->mean_reprojection_error_px = error_sum / std::max(result->num_observations, 1);
}

}  // namespace lazyloc

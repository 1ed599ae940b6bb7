#include "colmap_lazyloc/testing/synthetic_tracks.h"

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {

Observation ObserveAt(const Eigen::Vector3d& point_in_cam, double focal_length_px, const Eigen::Vector2d& offset_px) {
  Observation observation;
  const Eigen::Vector3d ray = point_in_cam.normalized();
  const Eigen::Vector3d offset = TangentBasis(ray) * offset_px / focal_length_px;
  observation.ray_in_cam = (ray + offset).normalized();
  observation.px_from_cam = focal_length_px * TangentBasis(observation.ray_in_cam).transpose();
  return observation;
}

SyntheticTracks MakeSyntheticTracks(const SyntheticTracksOptions& options) {
  Random random(options.seed);
  SyntheticTracks scene;
  for (int view = 0; view < options.num_query + options.num_database; ++view) {
    const Eigen::Vector3d centre = Eigen::Vector3d(0, 0, -8) + 2 * RandomVector(&random);
    scene.views.push_back({LookAt(centre, 0.3 * RandomVector(&random)), view >= options.num_query});
  }
  std::uniform_real_distribution<double> uniform;
  for (int point = 0; point < options.num_points; ++point) {
    Track track;
    track.point_in_world = RandomVector(&random);
    for (int view = 0; view < static_cast<int>(scene.views.size()); ++view) {
      const bool is_sure = !scene.views[view].is_database || view < options.num_query + 2;
      if (!is_sure && uniform(random) > options.min_views_ratio) continue;
      const Eigen::Vector2d offset_px = options.noise_px * RandomVector(&random).head<2>();
      const Eigen::Vector3d point_in_cam = scene.views[view].cam_from_world * track.point_in_world;
      track.observations.push_back({view, point, ObserveAt(point_in_cam, options.focal_length_px, offset_px)});
    }
    scene.tracks.push_back(track);
  }
  return scene;
}

}  // namespace lazyloc

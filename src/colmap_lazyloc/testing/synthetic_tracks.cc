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
  for (int i = 0; i < options.num_query + options.num_database; ++i) {
    const Eigen::Vector3d centre = Eigen::Vector3d(0, 0, -8) + 2 * RandomVector(&random);
    Frame frame;
    frame.frame_from_world = LookAt(centre, 0.3 * RandomVector(&random));
    frame.is_database = i >= options.num_query;
    scene.posed.frames.push_back(frame);
    Image image;
    image.frame = i;
    scene.posed.images.push_back(image);
  }
  std::uniform_real_distribution<double> uniform;
  for (int point = 0; point < options.num_points; ++point) {
    Track track;
    track.point_in_world = RandomVector(&random);
    for (int image = 0; image < static_cast<int>(scene.posed.images.size()); ++image) {
      const bool is_sure = image < options.num_query + 2;
      if (!is_sure && uniform(random) > options.min_images_ratio) continue;
      const Eigen::Vector2d offset_px = options.noise_px * RandomVector(&random).head<2>();
      const Eigen::Vector3d point_in_cam = CamFromWorld(scene.posed, image) * track.point_in_world;
      track.observations.push_back({image, point, ObserveAt(point_in_cam, options.focal_length_px, offset_px)});
    }
    scene.tracks.push_back(track);
  }
  return scene;
}

void JoinFrame(int first, int image, PosedImages* posed) {
  Image& joined = posed->images[image];
  const int removed = joined.frame;
  joined.cam_from_frame = CamFromWorld(*posed, image) * Inverse(posed->FrameOf(first).frame_from_world);
  joined.frame = posed->images[first].frame;
  posed->frames.erase(posed->frames.begin() + removed);
  for (Image& other : posed->images) other.frame -= other.frame > removed;
}

void DisturbQueries(SyntheticTracks* scene, double rotation_deg, double translation, double point) {
  Random random(17);
  for (Frame& frame : scene->posed.frames) {
    if (frame.is_database) continue;
    frame.frame_from_world.rotation = Disturbed(frame.frame_from_world.rotation, rotation_deg, &random);
    frame.frame_from_world.translation += translation * RandomVector(&random);
  }
  for (Track& track : scene->tracks) track.point_in_world += point * RandomVector(&random);
}

}  // namespace lazyloc

#include "colmap_lazyloc/paper/colmap_triangulation.h"

#include <optional>
#include <utility>

#include "colmap_lazyloc/bridge/triangulation.h"
#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

// Sets the point of a track and keeps the observations that agree with it. Returns false if the track is of no use.
bool Triangulate(const PosedImages& posed, const std::vector<Rigid3d>& cams_from_world,
                 const ColmapTriangulationOptions& options, Track* track) {
  std::vector<Rigid3d> poses;
  std::vector<Eigen::Vector3d> rays_in_cam;
  for (const TrackObservation& element : track->observations) {
    poses.push_back(cams_from_world[element.image]);
    rays_in_cam.push_back(element.observation.ray_in_cam);
  }
  const std::optional<Triangulation> found = TriangulateTrack(
      poses, rays_in_cam, DegToRad(options.max_angular_error_deg), DegToRad(options.min_triangulation_angle_deg));
  if (!found) return false;
  track->point_in_world = found->point_in_world;
  std::vector<TrackObservation> agreeing;
  for (size_t i = 0; i < track->observations.size(); ++i) {
    if (found->is_inlier[i]) agreeing.push_back(track->observations[i]);
  }
  track->observations = std::move(agreeing);
  return track->observations.size() >= 2 && !posed.IsDatabase(track->observations.front().image);
}

}  // namespace

std::vector<Track> TriangulateWithColmap(const PosedImages& posed, std::vector<Track> tracks,
                                         const ColmapTriangulationOptions& options) {
  const std::vector<Rigid3d> cams_from_world = CamsFromWorld(posed);
  std::vector<Track> triangulated;
  for (Track& track : tracks) {
    if (Triangulate(posed, cams_from_world, options, &track)) triangulated.push_back(std::move(track));
  }
  return triangulated;
}

}  // namespace lazyloc

#include "colmap_lazyloc/scene/track.h"

#include <cmath>

namespace lazyloc {

std::optional<Eigen::Vector3d> PointByDepth(const Image& image, const Rigid3d& cam_from_world,
                                            const TrackObservation& element) {
  const Eigen::Vector3d& ray = element.observation.ray_in_cam;
  if (!image.depth_scale || !(element.depth > 0) || !(ray.z() > 0)) return std::nullopt;
  const double depth = element.depth * std::exp(image.depth_scale->log_scale);
  return Inverse(cam_from_world) * Eigen::Vector3d(depth / ray.z() * ray);
}

}  // namespace lazyloc

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/scene/equirectangular.h"

namespace lazyloc {
namespace {

// Serves COLMAP 4.1 and later, because fisheye lenses may have rays behind the image plane.
template <typename ColmapCamera>
auto RayOf(const ColmapCamera& camera, const Eigen::Vector2d& xy, int) -> decltype(camera.CamRayFromImg(xy)) {
  return camera.CamRayFromImg(xy);
}

// Serves COLMAP 4.0, because it has no CamRayFromImg.
template <typename ColmapCamera>
std::optional<Eigen::Vector3d> RayOf(const ColmapCamera& camera, const Eigen::Vector2d& xy, long) {
  const std::optional<Eigen::Vector2d> normalized = camera.CamFromImg(xy);
  if (!normalized) return std::nullopt;
  return normalized->homogeneous().normalized();
}

}  // namespace

RayInCamFunction RaysInCam(const Camera& camera) {
  if (IsEquirectangular(camera)) return [camera](const Eigen::Vector2d& xy) { return EquirectangularRay(camera, xy); };
  return [converted = ToColmap(camera)](const Eigen::Vector2d& xy) {
    std::optional<Eigen::Vector3d> ray = RayOf(converted, xy, 0);
    if (ray && !ray->allFinite()) ray.reset();
    return ray;
  };
}

std::optional<Eigen::Vector2d> ImageFromCam(const Camera& camera, const Eigen::Vector3d& point_in_cam) {
  if (IsEquirectangular(camera)) return EquirectangularPoint(camera, point_in_cam);
  return ToColmap(camera).ImgFromCam(point_in_cam);
}

}  // namespace lazyloc

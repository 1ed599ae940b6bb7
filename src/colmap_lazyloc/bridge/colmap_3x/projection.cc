#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/scene/equirectangular.h"

namespace lazyloc {

RayInCamFunction RaysInCam(const Camera& camera) {
  if (IsEquirectangular(camera)) return [camera](const Eigen::Vector2d& xy) { return EquirectangularRay(camera, xy); };
  return [converted = ToColmap(camera)](const Eigen::Vector2d& xy) -> std::optional<Eigen::Vector3d> {
    const Eigen::Vector2d normalized = converted.CamFromImg(xy);
    if (!normalized.allFinite()) return std::nullopt;
    return normalized.homogeneous().normalized();
  };
}

std::optional<Eigen::Vector2d> ImageFromCam(const Camera& camera, const Eigen::Vector3d& point_in_cam) {
  if (IsEquirectangular(camera)) return EquirectangularPoint(camera, point_in_cam);
  if (point_in_cam.z() <= 0) return std::nullopt;
  return ToColmap(camera).ImgFromCam(point_in_cam.hnormalized());
}

}  // namespace lazyloc

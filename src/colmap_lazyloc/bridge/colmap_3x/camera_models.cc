#include "colmap_lazyloc/bridge/camera_models.h"

#include <cmath>

#include "colmap_lazyloc/bridge/colmap_3x/convert.h"

namespace lazyloc {

std::optional<int> CameraModelId(const std::string& model_name) {
  if (!colmap::ExistsCameraModelWithName(model_name)) return std::nullopt;
  return static_cast<int>(colmap::CameraModelNameToId(model_name));
}

std::string CameraModelName(int model_id) {
  const auto id = static_cast<colmap::CameraModelId>(model_id);
  return colmap::ExistsCameraModelWithId(id) ? colmap::CameraModelIdToName(id) : "";
}

size_t CameraModelNumParams(int model_id) {
  const auto id = static_cast<colmap::CameraModelId>(model_id);
  return colmap::ExistsCameraModelWithId(id) ? colmap::CameraModelNumParams(id) : 0;
}

std::string CameraProblem(const Camera& camera) {
  const std::string name = CameraModelName(camera.model_id);
  if (name.empty()) return "unknown camera model " + std::to_string(camera.model_id);
  const size_t num_params = CameraModelNumParams(camera.model_id);
  if (camera.params.size() != num_params) {
    return "camera model " + name + " takes " + std::to_string(num_params) + " parameters, not " +
           std::to_string(camera.params.size());
  }
  for (const double param : camera.params) {
    if (!std::isfinite(param)) return "a camera parameter is not a finite number";
  }
  if (camera.width == 0 || camera.height == 0) return "the camera's image size is zero";
  const colmap::Camera converted = ToColmap(camera);
  for (const size_t idx : converted.FocalLengthIdxs()) {
    if (camera.params[idx] <= 0) return "the camera's focal length is not positive";
  }
  return "";
}

Camera CameraFromFocalLength(int model_id, double focal_length_px, uint64_t width, uint64_t height) {
  const colmap::Camera made = colmap::Camera::CreateFromModelId(
      /*camera_id=*/0, static_cast<colmap::CameraModelId>(model_id), focal_length_px, width, height);
  return {0, model_id, width, height, made.params, /*has_prior_focal_length=*/true};
}

std::optional<Eigen::Vector3d> RayInCam(const Camera& camera, const Eigen::Vector2d& xy) {
  return RaysInCam(camera)(xy);
}

RayInCamFunction RaysInCam(const Camera& camera) {
  return [converted = ToColmap(camera)](const Eigen::Vector2d& xy) -> std::optional<Eigen::Vector3d> {
    const Eigen::Vector2d normalized = converted.CamFromImg(xy);
    if (!normalized.allFinite()) return std::nullopt;
    return normalized.homogeneous().normalized();
  };
}

std::optional<Eigen::Vector2d> ImageFromCam(const Camera& camera, const Eigen::Vector3d& point_in_cam) {
  if (point_in_cam.z() <= 0) return std::nullopt;
  return ToColmap(camera).ImgFromCam(point_in_cam.hnormalized());
}

}  // namespace lazyloc

#include "colmap_lazyloc/bridge/observation.h"

#include <algorithm>
#include <array>

#include <Eigen/Geometry>
#include <ceres/jet.h>
#include <colmap/sensor/models.h>

namespace lazyloc {
namespace {

using Jet = ceres::Jet<double, 3>;

// The model's inverse gives the ray. The derivative is that of the model itself there, exact by COLMAP's templates; it
// annihilates the ray, along which nothing moves in the image.
template <typename CameraModel>
std::function<std::optional<Observation>(const Eigen::Vector2d&)> ObserveBy(const std::vector<double>& params) {
  std::array<Jet, CameraModel::num_params> constant_params;
  std::transform(params.begin(), params.end(), constant_params.begin(), [](double param) { return Jet(param); });
  return [params, constant_params](const Eigen::Vector2d& xy) -> std::optional<Observation> {
    Observation observation;
    Eigen::Vector3d& ray = observation.ray_in_cam;
    CameraModel::CamFromImg(params.data(), xy.x(), xy.y(), &ray.x(), &ray.y(), &ray.z());
    ray.normalize();
    Jet x, y;
    CameraModel::ImgFromCam(constant_params.data(), Jet(ray.x(), 0), Jet(ray.y(), 1), Jet(ray.z(), 2), &x, &y);
    observation.px_from_cam << x.v.transpose(), y.v.transpose();
    if (!ray.allFinite() || !observation.px_from_cam.allFinite()) return std::nullopt;
    return observation;
  };
}

}  // namespace

Observer::Observer(const Camera& camera) {
  switch (static_cast<colmap::CameraModelId>(camera.model_id)) {
#define CAMERA_MODEL_CASE(CameraModel) \
  case colmap::CameraModel::model_id: observe_ = ObserveBy<colmap::CameraModel>(camera.params); break;
    CAMERA_MODEL_SWITCH_CASES
#undef CAMERA_MODEL_CASE
  }
}

}  // namespace lazyloc

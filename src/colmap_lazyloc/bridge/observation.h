#pragma once

#include <optional>

#include <Eigen/Core>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

// Turns a camera's image points (pixels) into observations: viewing ray and its derivative, by the camera model's inverse;
// none where that does not exist.
class Observer {
 public:
  explicit Observer(const Camera& camera) : ray_in_cam_(RaysInCam(camera)) {}
  std::optional<Observation> operator()(const Eigen::Vector2d& xy) const;

 private:
  RayInCamFunction ray_in_cam_;
};

}  // namespace lazyloc

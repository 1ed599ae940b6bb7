#pragma once

#include <functional>
#include <optional>

#include <Eigen/Core>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

// Turns a camera's image points (pixels) into observations: viewing ray, by the camera model's inverse, and the model's
// derivative there; none where these do not exist. Of a usable camera (see CameraProblem).
class Observer {
 public:
  explicit Observer(const Camera& camera);
  std::optional<Observation> operator()(const Eigen::Vector2d& xy) const { return observe_(xy); }

 private:
  std::function<std::optional<Observation>(const Eigen::Vector2d& xy)> observe_;
};

}  // namespace lazyloc

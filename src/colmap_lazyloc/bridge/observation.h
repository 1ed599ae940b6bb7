#pragma once

#include <optional>

#include <Eigen/Core>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

// Turns a camera's image points (pixels) into observations: viewing ray and its derivative, by the camera model's
// inverse; none where that does not exist. The derivative by the focal length, too, where this is sought.
class Observer {
 public:
  explicit Observer(const Camera& camera, bool seeks_focal_length = false);
  std::optional<Observation> operator()(const Eigen::Vector2d& xy) const;

 private:
  RayInCamFunction ray_in_cam_;
  // With a slightly shorter and longer focal length; empty where it is known.
  RayInCamFunction ray_in_shorter_cam_, ray_in_longer_cam_;
};

}  // namespace lazyloc

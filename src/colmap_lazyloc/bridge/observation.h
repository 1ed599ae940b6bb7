#pragma once

#include <optional>

#include <Eigen/Core>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

// Computes observations (viewing rays with their pixel derivatives) from image points in pixels of one camera, by
// numeric differentiation of the camera model's inverse. Sets px_from_log_focal, too, if seeks_focal_length is true.
class Observer {
 public:
  explicit Observer(const Camera& camera, bool seeks_focal_length = false);
  // Returns nullopt if the camera model cannot be inverted at xy or next to it.
  std::optional<Observation> operator()(const Eigen::Vector2d& xy) const;

 private:
  RayInCamFunction ray_in_cam_;
  // Inverses of the camera with a slightly shorter and longer focal length; empty if the focal length is known.
  RayInCamFunction ray_in_shorter_cam_, ray_in_longer_cam_;
};

}  // namespace lazyloc

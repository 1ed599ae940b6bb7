#pragma once

#include <optional>

#include <Eigen/Core>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

// Computes observations (viewing rays with their pixel derivatives) from image points in pixels of one camera, by
// numeric differentiation of the camera model's inverse.
class Observer {
 public:
  explicit Observer(const Camera& camera);
  // Returns nullopt if the camera model cannot be inverted at xy or next to it.
  std::optional<Observation> operator()(const Eigen::Vector2d& xy) const;

 private:
  RayInCamFunction ray_in_cam_;
  Eigen::Vector2d principal_point_;
};

}  // namespace lazyloc

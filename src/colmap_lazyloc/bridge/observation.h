#pragma once

#include <optional>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

// The viewing ray of an image point and its derivative, by the camera model's inverse; none where that does not exist.
std::optional<Observation> Observe(const Camera& camera, const Eigen::Vector2d& xy);

}  // namespace lazyloc

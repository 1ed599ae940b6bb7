#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/scene/camera.h"

namespace lazyloc {

// The camera model EQUIRECTANGULAR of COLMAP 4.1, whose parameters are the width and the height of the image. It is
// here, because older COLMAPs lack it, and because their functions serve only points in front of the image plane.

inline constexpr char kEquirectangular[] = "EQUIRECTANGULAR";
inline constexpr int kEquirectangularId = 17;

inline bool IsEquirectangular(const Camera& camera) { return camera.model_id == kEquirectangularId; }

// Returns the unit ray of a point of the image: x right, y down, z to the middle. Any point has one, because the image
// goes on beyond its borders.
Eigen::Vector3d EquirectangularRay(const Camera& camera, const Eigen::Vector2d& xy);

// Returns the image point of a direction other than zero.
Eigen::Vector2d EquirectangularPoint(const Camera& camera, const Eigen::Vector3d& direction_in_cam);

// Returns the number of pixels per radian on the horizon, which stands for the focal length.
double EquirectangularPxPerRad(const Camera& camera);

}  // namespace lazyloc

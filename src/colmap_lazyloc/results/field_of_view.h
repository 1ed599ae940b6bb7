#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"

namespace lazyloc {

// Returns what a camera sees up to a distance, from above (along z): the convex hull of its centre and of the ends of
// its viewing rays at this distance. It is a wedge if the camera looks at the horizon, and the photo's outline if it
// looks down. Points of the world, counterclockwise seen from above, each once; none if the camera model has no rays.
std::vector<Eigen::Vector3d> FieldOfViewFromAbove(const Rigid3d& world_from_cam, const Camera& camera, double distance);

}  // namespace lazyloc

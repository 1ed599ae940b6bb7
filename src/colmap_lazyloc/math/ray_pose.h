#pragma once

#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {

// Relative poses of unit rays of any direction, matched one by one: query_ray^T E other_ray = 0.
using Rays = std::vector<Eigen::Vector3d>;

// Returns the squared sines of the angles between rays and their epipolar planes, to first order.
std::vector<double> SquaredEpipolarErrors(const Rays& other, const Rays& query, const Eigen::Matrix3d& E);

// Returns the essential matrix with the least sum of squared constraints, of 8 rays or more.
Eigen::Matrix3d FitEssentialMatrix(const Rays& other, const Rays& query);

// Returns the pose of an essential matrix with most points on the rays, not on their extensions.
Rigid3d PoseOfEssentialMatrix(const Eigen::Matrix3d& E, const Rays& other, const Rays& query);

// Returns the rotation query_from_other with the least squared distances of the better half of the rays.
Eigen::Quaterniond FitRotationOfRays(const Rays& other, const Rays& query);

}  // namespace lazyloc

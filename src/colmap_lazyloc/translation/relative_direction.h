#pragma once

#include <vector>

#include <Eigen/Core>

namespace lazyloc {

// A matched pair of viewing rays, unit length, both turned into the world, with their noise.
struct RayPair {
  Eigen::Vector3d ray1_in_world;
  Eigen::Vector3d ray2_in_world;
  double stddev_rad = 1e-3;  // of each ray
};

struct RelativeDirection {
  // Unit (cam2_in_world - cam1_in_world); zero where the rays do not tell.
  Eigen::Vector3d dir_1to2_in_world = Eigen::Vector3d::Zero();
  double stddev_rad = 0;  // of the worse of its two angles, by the rays' noise
};

// Direction of the baseline between two cameras whose rotations are known: every ray pair (f1, f2) obeys the epipolar
// constraint (f1 x f2) . dir = 0, so that dir is the smallest eigenvector of sum w n n^T with n = f1 x f2, where w
// normalises each constraint by its own noise and discounts outliers. It starts from a vote among the directions that
// two ray pairs give. Its sign is the one that puts more points in front of both cameras. LazyLoc section 3.2; Lee &
// Civera, Closed-Form Optimal Two-View Triangulation, for the constraint's noise.
RelativeDirection EstimateRelativeDirection(const std::vector<RayPair>& rays);

}  // namespace lazyloc

#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/epipolar_error.h"

namespace lazyloc {

struct RelativeDirection {
  // Unit vector along cam2_in_world - cam1_in_world; zero if the rays do not determine it.
  Eigen::Vector3d dir_1to2_in_world = Eigen::Vector3d::Zero();
  double stddev_rad = 0;  // of the worse of its two angles, from the noise of the rays
};

// Estimates the direction of the baseline between two cameras whose rotations are known. Every match (f1, f2)
// fulfils the epipolar constraint (f1 x f2) . dir = 0. Therefore dir is the eigenvector of sum w n n^T, n = f1 x f2,
// with the smallest eigenvalue. The weight w normalises each constraint by its noise and down-weights outliers. The
// iteration starts from the best of the directions that two matches give each. The sign puts more points in front of
// both cameras. LazyLoc (arXiv 2307.09981), section 3.2. For the noise of the constraint: Lee & Civera, Closed-Form
// Optimal Two-View Triangulation Based on Angular Errors, ICCV 2019.
RelativeDirection EstimateRelativeDirection(const std::vector<RayMatch>& matches);

}  // namespace lazyloc

#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// A match of a free view's image point with one of a fixed view.
struct EpipolarMatch {
  Eigen::Vector3d fixed_in_world;      // the fixed view's centre
  Eigen::Vector3d fixed_ray_in_world;  // its ray
  Eigen::Vector3d free_ray_in_cam;
  // How a ray moves with its image point, 3x2, times the point's standard deviation; the fixed view's in the world.
  Eigen::Matrix<double, 3, 2> fixed_ray_noise_in_world;
  Eigen::Matrix<double, 3, 2> free_ray_noise_in_cam;
};

EpipolarMatch MakeEpipolarMatch(const View& fixed_view, const Observation& fixed_observation, const View& free_view,
                                const Observation& free_observation, double noise_ratio);

// Sampson's error in standard deviations, for the free view's rotation and centre, and its derivative with respect to
// (w, dC): R <- ExpSO3(w) R, C <- C + dC. Zero without baseline, of which it says nothing.
double SampsonError(const EpipolarMatch& match, const Eigen::Matrix3d& cam_from_world_rotation,
                    const Eigen::Vector3d& cam_in_world, Eigen::Matrix<double, 1, 6>* jacobian);

}  // namespace lazyloc

#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

// A match between a query and a database image.
struct EpipolarMatch {
  Eigen::Vector3d database_in_world;      // projection centre
  Eigen::Vector3d database_ray_in_world;  // unit length
  Eigen::Vector3d query_ray_in_cam;       // unit length
  // Derivatives of the rays with respect to their keypoints, times the keypoints' standard deviations.
  Eigen::Matrix<double, 3, 2> database_ray_noise_in_world;
  Eigen::Matrix<double, 3, 2> query_ray_noise_in_cam;
};

// An observation with the standard deviation of its keypoint.
struct NoisyObservation {
  const Observation& observation;
  double noise_px = 1;
};

EpipolarMatch MakeEpipolarMatch(const Rigid3d& database_from_world, const NoisyObservation& database,
                                const NoisyObservation& query);

// Returns Sampson's error in standard deviations for the query's rotation and centre, and its derivative with respect
// to (w, dC): R <- ExpSO3(w) R, C <- C + dC. Zero without baseline, because the error then tells nothing.
double SampsonError(const EpipolarMatch& match, const Eigen::Matrix3d& cam_from_world_rotation,
                    const Eigen::Vector3d& cam_in_world, Eigen::Matrix<double, 1, 6>* jacobian);

}  // namespace lazyloc

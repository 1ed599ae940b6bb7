#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

// Matched viewing rays of two images, in axes that both share.
struct RayMatch {
  Eigen::Vector3d ray1, ray2;                     // unit length
  double stddev1_rad = 1e-3, stddev2_rad = 1e-3;  // noise of each ray, per axis
};

// Returns the match of two keypoints with a noise of one pixel.
inline RayMatch MakeRayMatch(const Eigen::Matrix3d& world_from_cam1, const Observation& observation1,
                             const Eigen::Matrix3d& world_from_cam2, const Observation& observation2) {
  return {world_from_cam1 * observation1.ray_in_cam, world_from_cam2 * observation2.ray_in_cam, RadFromPx(observation1),
          RadFromPx(observation2)};
}

// Returns Sampson's error of a match in standard deviations: g = baseline . (ray1 x ray2) over the standard deviation
// of g, to first order in the noise of both rays (Sampson 1982; Hartley & Zisserman, Multiple View Geometry, section
// 11.4.3). Zero without baseline, because the error then tells nothing. Sets its derivative by a turn of the second
// camera in the axes of the rays, ray2 <- ray2 + ray2 x turn, and by a step of its centre.
double SampsonError(const RayMatch& match, const Eigen::Vector3d& baseline_1to2,
                    Eigen::Matrix<double, 1, 6>* jacobian = nullptr);

// Error of a match of two images.
struct EpipolarError {
  double squared_px = 0;     // square of Sampson's error, or of the parallax if the point is behind an image
  bool is_in_front = false;  // true if the point is in front of both images
};

// a_from_b: relative pose of the two images, in the axes of their cameras; its translation may have any length but
// zero.
EpipolarError MeasureEpipolarError(const Rigid3d& a_from_b, const Observation& a, const Observation& b);

}  // namespace lazyloc

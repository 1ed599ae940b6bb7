#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {

struct Triangulation {
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  std::vector<bool> is_inlier;  // one entry per observation; at least two are true
};

// Triangulates one track with COLMAP's robust multi-view triangulation (EstimateTriangulation): LO-RANSAC over pairs of
// observations. Each pair gives a point by the direct linear transform (DLT), and the inliers of a better point than
// all before it give a point by a DLT again. The same input gives the same result, without a seed, because COLMAP tries
// the pairs in a fixed order.
//   cams_from_world, rays_in_cam: one entry per observation; the lengths of the rays do not matter.
//   max_angular_error_rad: maximum angle between the ray of an inlier and the point; greater than 0.
//   min_triangulation_angle_rad: angle at the point that at least one pair of inliers must exceed.
// Returns nullopt
//   - if there are fewer than two observations,
//   - if no pair of them intersects in front of both cameras at the minimum angle,
//   - if a ray has z <= 0 (a camera of more than 180 degrees), because COLMAP up to 4.0 takes a ray as its point in the
//     plane z = 1 and cannot represent it.
// Choose an origin near the cameras: the DLT loses digits if the cameras are close together and far from the origin.
std::optional<Triangulation> TriangulateTrack(const std::vector<Rigid3d>& cams_from_world,
                                              const std::vector<Eigen::Vector3d>& rays_in_cam,
                                              double max_angular_error_rad, double min_triangulation_angle_rad);

}  // namespace lazyloc

#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/math/ray_pose.h"
#include "colmap_lazyloc/scene/features.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

// SIFT descriptors of an image, with the viewing ray of each: unit length, zero where there is none.
struct DescriptorsWithRays {
  const Descriptors& descriptors;
  const Rays& rays;
};

// Matches the descriptors of two images like MatchDescriptors, but each only with those near its epipolar line. E: of
// the pair, query_ray^T E other_ray = 0. max_error_rad: of matched rays, to first order. Returns the sorted matches.
Matches MatchAlongEpipolarLines(const DescriptorsWithRays& query, const DescriptorsWithRays& other,
                                const Eigen::Matrix3d& E, double max_error_rad);

}  // namespace lazyloc

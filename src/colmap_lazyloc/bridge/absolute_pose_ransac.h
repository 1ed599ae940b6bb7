#pragma once

#include <algorithm>
#include <limits>

#include <colmap/optim/ransac.h>

#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/bridge/random_numbers.h"

namespace lazyloc {

// Estimates an absolute pose, of a single camera or a rig, by one of COLMAP's RANSACs. max_error: in the unit of the
// square root of the estimator's residuals. Returns nullopt if no pose is found.
template <typename Ransac, typename Ray>
std::optional<Rigid3d> EstimateByRansac(const std::vector<Ray>& rays,
                                        const std::vector<Eigen::Vector3d>& points_in_world, double max_error,
                                        uint32_t seed, double min_inlier_ratio) {
  colmap::RANSACOptions options;
  // A camera whose principal point is far from the image has rays so close together that their bound is 0, which RANSAC
  // refuses.
  options.max_error = std::max(std::numeric_limits<double>::min(), max_error);
  options.min_inlier_ratio = min_inlier_ratio;
  options.confidence = 0.9999;
  options.min_num_trials = 20;
  options.max_num_trials = 5000;
  SeedRandomNumbers(seed);
  const auto report = Ransac(options).Estimate(rays, points_in_world);
  return report.success ? FiniteRigid(report.model) : std::nullopt;
}

}  // namespace lazyloc

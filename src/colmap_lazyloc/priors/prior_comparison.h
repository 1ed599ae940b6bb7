#pragma once

#include <optional>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "colmap_lazyloc/math/two_rays.h"
#include "colmap_lazyloc/scene/pose_distribution.h"
#include "colmap_lazyloc/scene/query_prior.h"

namespace lazyloc {

// Squared deviation of a prior, in standard deviations of the difference, from which the images contradict it: the
// 99.9 % quantiles of the chi-square distribution with 2 and 3 degrees of freedom.
inline constexpr double kContradictionOfTwo = 13.816, kContradictionOfThree = 16.266;

// What the images say of a prior: contradicted above these quantiles.
struct PriorComparison {
  PriorResult result;
  double factor = 1;  // on the prior's covariance: from the 95 % quantile on, a prior is used as if less certain
};

PriorComparison ComparePosition(const PositionPrior& prior, const PoseDistribution& pose);
PriorComparison CompareGravity(const GravityPrior& prior, const Eigen::Quaterniond& cam_from_world_rotation,
                               const Eigen::Matrix3d& covariance);

// Sets the result of a prior. Returns the prior as certain as it is used, its covariance over variance_factor; nullopt
// if the images contradict it.
template <typename Prior>
std::optional<Prior> UsedPrior(const Prior& prior, const PriorComparison& comparison,
                               std::optional<PriorResult>* result, double variance_factor = 1) {
  *result = comparison.result;
  if (comparison.result.verdict != PriorVerdict::USED) return std::nullopt;
  return Scaled(prior, comparison.factor / variance_factor);
}

// The place on a ray that agrees best with a position.
struct PlaceOnRay {
  Eigen::Vector3d place_in_world;
  PriorComparison comparison;
};

// Compares a position with a ray in the world, across the ray. The deviation along it counts only if the position is
// behind the place that the ray starts from. stddev_rad: of the ray's direction.
PlaceOnRay CompareWithRay(const PositionPrior& prior, const Ray& ray, double stddev_rad);

}  // namespace lazyloc

#pragma once

#include <array>
#include <cmath>
#include <optional>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/enum_names.h"

namespace lazyloc {

// Position of the camera of a query, from GPS for example.
struct PositionPrior {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // of the projection centre in the world, in database units
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
};

// Direction of gravity at a query, from an accelerometer for example.
struct GravityPrior {
  Eigen::Vector3d down_in_cam = Eigen::Vector3d::UnitY();  // unit length
  Eigen::Vector3d down_in_world = -Eigen::Vector3d::UnitZ();
  double stddev_rad = 0;  // of the direction, about each axis across it
};

// Return a prior whose covariance is multiplied by a factor.
inline PositionPrior Scaled(PositionPrior prior, double factor) {
  prior.covariance *= factor;
  return prior;
}
inline GravityPrior Scaled(GravityPrior prior, double factor) {
  prior.stddev_rad *= std::sqrt(factor);
  return prior;
}

// What is known of a query's pose beside its matches.
struct QueryPrior {
  std::optional<PositionPrior> position;
  std::optional<GravityPrior> gravity;
};

// The prior of an image that adjustment uses.
struct ImagePrior {
  int image = -1;
  QueryPrior prior;
};

// What the images say of a prior.
enum class PriorVerdict {
  NOT_TESTED,    // the images give no pose that it could be compared with
  USED,          // the images agree with it, or do not determine what it says
  CONTRADICTED,  // the images contradict it, and it was left out
};
template <>
inline constexpr std::array<const char*, 3> kEnumNames<PriorVerdict> = {"not_tested", "used", "contradicted"};

// What a prior fixes of the pose because the images do not determine it.
enum class PriorRole {
  NOTHING,   // the images determine the pose; the prior makes it more certain
  DISTANCE,  // the place on a line on which the images put the query
  POSITION,  // the whole position
};
template <>
inline constexpr std::array<const char*, 3> kEnumNames<PriorRole> = {"nothing", "distance", "position"};

// What became of a prior.
struct PriorResult {
  PriorVerdict verdict = PriorVerdict::NOT_TESTED;
  PriorRole fixes = PriorRole::NOTHING;
  // Distance between the prior and the pose that the images give, along the directions that these determine: in
  // database units or rad, and in standard deviations of the difference (Mahalanobis distance). Only if tested.
  double deviation = 0;
  double deviation_sigma = 0;
};

// What became of the priors of a query; nullopt for a prior that it does not have.
struct QueryPriorResult {
  std::optional<PriorResult> position, gravity;
};

// Returns the result of priors before anything tests them.
inline QueryPriorResult UntestedPriors(const QueryPrior& prior) {
  QueryPriorResult result;
  if (prior.position) result.position.emplace();
  if (prior.gravity) result.gravity.emplace();
  return result;
}

}  // namespace lazyloc

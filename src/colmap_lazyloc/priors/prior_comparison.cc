#include "colmap_lazyloc/priors/prior_comparison.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

// Quantiles of the chi-square distribution with 2 and 3 degrees of freedom.
struct Quantiles {
  double suspicious;     // 95 %
  double contradictory;  // 99.9 %
};
constexpr Quantiles kTwoDegrees = {5.991, kContradictionOfTwo}, kThreeDegrees = {7.815, kContradictionOfThree};

// Compares a deviation with its covariance.
template <typename Vector, typename Matrix>
PriorComparison Compare(const Vector& deviation, const Matrix& covariance, const Quantiles& quantiles) {
  const double squared_sigma = deviation.dot(covariance.ldlt().solve(deviation));
  const bool is_used = squared_sigma <= quantiles.contradictory;
  PriorComparison comparison;
  comparison.result = {is_used ? PriorVerdict::USED : PriorVerdict::CONTRADICTED, PriorRole::NOTHING, deviation.norm(),
                       std::sqrt(squared_sigma)};
  comparison.factor = std::max(1.0, squared_sigma / quantiles.suspicious);
  return comparison;
}

}  // namespace

PriorComparison ComparePosition(const PositionPrior& prior, const PoseDistribution& pose) {
  return Compare(Eigen::Vector3d(prior.position - CamInWorld(pose.cam_from_world)),
                 Eigen::Matrix3d(prior.covariance + pose.PositionCovariance()), kThreeDegrees);
}

PriorComparison CompareGravity(const GravityPrior& prior, const Eigen::Quaterniond& cam_from_world_rotation,
                               const Eigen::Matrix3d& covariance) {
  const Eigen::Vector3d down = cam_from_world_rotation * prior.down_in_world;
  const Eigen::Matrix<double, 3, 2> basis = TangentBasis(down);
  // Turns opposite directions, whose cross product is zero, about any axis.
  Eigen::Vector2d axis = basis.transpose() * down.cross(prior.down_in_cam);
  axis = axis.isZero(1e-9) ? Eigen::Vector2d::UnitX() : Eigen::Vector2d(axis.normalized());
  const Eigen::Matrix2d turn_covariance = basis.transpose() * covariance * basis;
  return Compare(Eigen::Vector2d(AngleBetweenRad(down, prior.down_in_cam) * axis),
                 Eigen::Matrix2d(turn_covariance + prior.stddev_rad * prior.stddev_rad * Eigen::Matrix2d::Identity()),
                 kTwoDegrees);
}

PlaceOnRay CompareWithRay(const PositionPrior& prior, const Ray& ray, double stddev_rad) {
  const Eigen::Vector3d& direction = ray.dir;
  const Eigen::LDLT<Eigen::Matrix3d> covariance(prior.covariance);
  const Eigen::Vector3d information = covariance.solve(direction);
  const Eigen::Vector3d offset = prior.position - ray.origin;
  const double stddev_along = 1 / std::sqrt(information.dot(direction));
  // A query is ahead of the database image, at a distance that is not certain to be zero.
  const double distance = std::max(information.dot(offset) * stddev_along * stddev_along, stddev_along);
  const double across = stddev_rad * distance;
  const Eigen::Matrix3d around = across * across * (Eigen::Matrix3d::Identity() - direction * direction.transpose());
  return {ray.origin + distance * direction, Compare(Eigen::Vector3d(offset - distance * direction),
                                                     Eigen::Matrix3d(prior.covariance + around), kTwoDegrees)};
}

}  // namespace lazyloc

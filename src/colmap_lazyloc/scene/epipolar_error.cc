#include "colmap_lazyloc/scene/epipolar_error.h"

#include <cmath>

#include "colmap_lazyloc/math/two_rays.h"

namespace lazyloc {

double SampsonError(const RayMatch& match, const Eigen::Vector3d& baseline_1to2,
                    Eigen::Matrix<double, 1, 6>* jacobian) {
  const Eigen::Vector3d by_ray1 = match.ray2.cross(baseline_1to2), by_ray2 = baseline_1to2.cross(match.ray1);
  const double variance1 = match.stddev1_rad * match.stddev1_rad, variance2 = match.stddev2_rad * match.stddev2_rad;
  const double stddev = std::sqrt(variance1 * by_ray1.squaredNorm() + variance2 * by_ray2.squaredNorm());
  if (jacobian != nullptr) jacobian->setZero();
  if (stddev == 0) return 0;
  const double error = by_ray2.dot(match.ray2) / stddev;
  if (jacobian == nullptr) return error;
  Eigen::Matrix<double, 1, 6> of_gap, of_variance;  // of g, and half of that of its variance
  of_gap << by_ray2.cross(match.ray2).transpose(), match.ray1.cross(match.ray2).transpose();
  of_variance << variance1 * baseline_1to2.cross(by_ray1).cross(match.ray2).transpose(),
      (variance1 * by_ray1.cross(match.ray2) + variance2 * match.ray1.cross(by_ray2)).transpose();
  *jacobian = (of_gap - error / stddev * of_variance) / stddev;
  return error;
}

EpipolarError MeasureEpipolarError(const Rigid3d& a_from_b, const Observation& a, const Observation& b) {
  const Eigen::Matrix3d b_from_a = a_from_b.rotation.conjugate().toRotationMatrix();
  const RayMatch match = MakeRayMatch(Eigen::Matrix3d::Identity(), b, b_from_a, a);
  const Eigen::Vector3d baseline = CamInWorld(a_from_b).normalized();
  const auto nearest = FindNearestPoints(match.ray1, match.ray2, baseline, 0);
  if (nearest && nearest->AreAhead()) return {std::pow(SampsonError(match, baseline), 2), true};
  const double variance = match.stddev1_rad * match.stddev1_rad + match.stddev2_rad * match.stddev2_rad;
  return {match.ray1.cross(match.ray2).squaredNorm() / variance, false};
}

}  // namespace lazyloc

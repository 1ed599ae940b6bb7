#include "colmap_lazyloc/math/so3.h"

#include <cmath>

namespace lazyloc {

Eigen::Matrix3d Hat(const Eigen::Vector3d& w) {
  Eigen::Matrix3d hat;
  hat << 0, -w.z(), w.y(), w.z(), 0, -w.x(), -w.y(), w.x(), 0;
  return hat;
}

Eigen::Quaterniond ExpSO3(const Eigen::Vector3d& w) {
  const double angle = w.norm();
  // Uses the series of sin(angle / 2) / angle for small angles, because the quotient loses digits.
  const double factor = angle < 1e-6 ? 0.5 - angle * angle / 48 : std::sin(angle / 2) / angle;
  const Eigen::Vector3d xyz = factor * w;
  return Eigen::Quaterniond(std::cos(angle / 2), xyz.x(), xyz.y(), xyz.z()).normalized();
}

Eigen::Vector3d LogSO3(const Eigen::Quaterniond& rotation) {
  const double sign = rotation.w() < 0 ? -1 : 1;
  const double sin_half = rotation.vec().norm();
  if (sin_half < 1e-12) return 2 * sign * rotation.vec();
  return 2 * sign * std::atan2(sin_half, sign * rotation.w()) / sin_half * rotation.vec();
}

double AngularDistanceRad(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return LogSO3(a.conjugate() * b).norm();
}

double AngleBetweenRad(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

Eigen::Matrix<double, 3, 2> TangentBasis(const Eigen::Vector3d& direction) {
  int smallest;
  direction.cwiseAbs().minCoeff(&smallest);
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = direction.cross(Eigen::Vector3d::Unit(smallest)).normalized();
  basis.col(1) = direction.cross(basis.col(0));
  return basis;
}

}  // namespace lazyloc

#pragma once

#include <cmath>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace lazyloc {

// Rotation tangents are left perturbations: R <- ExpSO3(w) R.

Eigen::Matrix3d Hat(const Eigen::Vector3d& w);

// Rotation of angle |w| (rad) about w.
Eigen::Quaterniond ExpSO3(const Eigen::Vector3d& w);

// Inverse of ExpSO3, angle in [0, pi].
Eigen::Vector3d LogSO3(const Eigen::Quaterniond& rotation);

// Angle between two rotations, in [0, pi].
double AngularDistanceRad(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b);

// Angle between two directions of any length, in [0, pi]; accurate for small angles too.
double AngleBetweenRad(const Eigen::Vector3d& a, const Eigen::Vector3d& b);

// Two unit vectors that span the plane perpendicular to a unit vector, as columns; the same for the same input.
Eigen::Matrix<double, 3, 2> TangentBasis(const Eigen::Vector3d& direction);

// Whether four numbers of a file are meant as a rotation: of unit length, as far as a few digits tell.
inline bool IsUnitQuaternion(const Eigen::Quaterniond& q) { return std::abs(q.norm() - 1) < 1e-2; }

constexpr double kRadFromDeg = 3.14159265358979323846 / 180.0;
inline double DegToRad(double deg) { return deg * kRadFromDeg; }
inline double RadToDeg(double rad) { return rad / kRadFromDeg; }

}  // namespace lazyloc

#pragma once

#include <cmath>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace lazyloc {

// Rotation tangents are left perturbations: R <- ExpSO3(w) R.

// Returns the matrix [w]x with [w]x v = w x v.
Eigen::Matrix3d Hat(const Eigen::Vector3d& w);

// Returns the rotation by the angle |w| (rad) about w.
Eigen::Quaterniond ExpSO3(const Eigen::Vector3d& w);

// Returns the w with ExpSO3(w) = rotation and |w| in [0, pi].
Eigen::Vector3d LogSO3(const Eigen::Quaterniond& rotation);

// Returns the angle between two rotations, in [0, pi].
double AngularDistanceRad(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b);

// Returns the angle between two vectors of any length, in [0, pi]. Accurate for small angles too, because it uses
// atan2.
double AngleBetweenRad(const Eigen::Vector3d& a, const Eigen::Vector3d& b);

// Returns an orthonormal basis (columns) of the plane perpendicular to a unit vector.
Eigen::Matrix<double, 3, 2> TangentBasis(const Eigen::Vector3d& direction);

// True if four numbers of a file are a rotation: their norm is 1 within 1 %, because files may round to few digits.
inline bool IsUnitQuaternion(const Eigen::Quaterniond& q) { return std::abs(q.norm() - 1) < 1e-2; }

constexpr double kRadFromDeg = 3.14159265358979323846 / 180.0;
inline double DegToRad(double deg) { return deg * kRadFromDeg; }
inline double RadToDeg(double rad) { return rad / kRadFromDeg; }

}  // namespace lazyloc

#pragma once

#include <optional>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace lazyloc {

// Minimum sine of the angle between rays that determine a point (1.1 degrees), because nearly parallel ones cross
// anywhere.
inline constexpr double kMinCrossingSine = 0.02;

struct Ray {
  Eigen::Vector3d origin;
  Eigen::Vector3d dir;  // unit length
};

// Distances from the origins of two rays to the points that are nearest to the other ray; negative behind the origin.
struct NearestPoints {
  double distance1, distance2;

  bool AreAhead() const { return distance1 > 0 && distance2 > 0; }
};

// Returns nullopt if the sine of the angle between the rays is below min_sine. dir1, dir2: unit length. baseline_1to2:
// from the origin of the first ray to that of the second.
inline std::optional<NearestPoints> FindNearestPoints(const Eigen::Vector3d& dir1, const Eigen::Vector3d& dir2,
                                                      const Eigen::Vector3d& baseline_1to2,
                                                      double min_sine = kMinCrossingSine) {
  const Eigen::Vector3d normal = dir1.cross(dir2);
  const double squared_sine = normal.squaredNorm();
  if (!(squared_sine >= min_sine * min_sine)) return std::nullopt;
  return NearestPoints{baseline_1to2.cross(dir2).dot(normal) / squared_sine,
                       baseline_1to2.cross(dir1).dot(normal) / squared_sine};
}

// Returns the point between two rays, halfway between their nearest points; nullopt if one of these is behind its ray's
// origin, or if the rays are too parallel.
inline std::optional<Eigen::Vector3d> Crossing(const Ray& a, const Ray& b) {
  const std::optional<NearestPoints> nearest = FindNearestPoints(a.dir, b.dir, b.origin - a.origin);
  if (!nearest || !nearest->AreAhead()) return std::nullopt;
  return (a.origin + nearest->distance1 * a.dir + b.origin + nearest->distance2 * b.dir) / 2;
}

}  // namespace lazyloc

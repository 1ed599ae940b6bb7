#include "colmap_lazyloc/math/geodetic.h"

#include <cmath>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

constexpr double kSemiMajorAxis = 6378137;  // in metres
constexpr double kFlattening = 1 / 298.257223563;
constexpr double kSemiMinorAxis = kSemiMajorAxis * (1 - kFlattening);
constexpr double kSquaredEccentricity = kFlattening * (2 - kFlattening);
constexpr double kSquaredSecondEccentricity = kSquaredEccentricity / (1 - kSquaredEccentricity);

// Returns the distance along the normal from the ellipsoid to the axis of rotation.
double NormalRadius(double sin_latitude) {
  return kSemiMajorAxis / std::sqrt(1 - kSquaredEccentricity * sin_latitude * sin_latitude);
}

}  // namespace

Eigen::Vector3d EcefFromGeodetic(const GeodeticPoint& point) {
  const double latitude = DegToRad(point.latitude_deg), longitude = DegToRad(point.longitude_deg);
  const double radius = NormalRadius(std::sin(latitude));
  const double distance_to_axis = (radius + point.height_m) * std::cos(latitude);
  return {distance_to_axis * std::cos(longitude), distance_to_axis * std::sin(longitude),
          ((1 - kSquaredEccentricity) * radius + point.height_m) * std::sin(latitude)};
}

GeodeticPoint GeodeticFromEcef(const Eigen::Vector3d& point_in_ecef) {
  const double distance_to_axis = std::hypot(point_in_ecef.x(), point_in_ecef.y()), z = point_in_ecef.z();
  // Repeats Bowring's formula until its error is below rounding, for which twice is enough near the ground.
  double latitude = 0, reduced = std::atan2(z, (1 - kFlattening) * distance_to_axis);
  for (int i = 0; i < 5; ++i) {
    latitude = std::atan2(z + kSquaredSecondEccentricity * kSemiMinorAxis * std::pow(std::sin(reduced), 3),
                          distance_to_axis - kSquaredEccentricity * kSemiMajorAxis * std::pow(std::cos(reduced), 3));
    reduced = std::atan2((1 - kFlattening) * std::sin(latitude), std::cos(latitude));
  }
  const double sin_latitude = std::sin(latitude);
  const double height = distance_to_axis * std::cos(latitude) + z * sin_latitude -
                        kSemiMajorAxis * kSemiMajorAxis / NormalRadius(sin_latitude);
  return {RadToDeg(latitude), RadToDeg(std::atan2(point_in_ecef.y(), point_in_ecef.x())), height};
}

Eigen::Matrix3d EcefFromEnuRotation(const GeodeticPoint& place) {
  const double latitude = DegToRad(place.latitude_deg), longitude = DegToRad(place.longitude_deg);
  const Eigen::Vector3d east(-std::sin(longitude), std::cos(longitude), 0);
  const Eigen::Vector3d up(std::cos(latitude) * std::cos(longitude), std::cos(latitude) * std::sin(longitude),
                           std::sin(latitude));
  Eigen::Matrix3d axes;
  axes << east, up.cross(east), up;
  return axes;
}

GeodeticPoint GeodeticFromEnu(const GeodeticPoint& origin, const Eigen::Vector3d& point_in_enu) {
  return GeodeticFromEcef(EcefFromGeodetic(origin) + EcefFromEnuRotation(origin) * point_in_enu);
}

}  // namespace lazyloc

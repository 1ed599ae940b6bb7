#pragma once

#include <Eigen/Core>

namespace lazyloc {

// A place on Earth in the coordinates of the ellipsoid WGS84.
struct GeodeticPoint {
  double latitude_deg = 0;
  double longitude_deg = 0;
  double height_m = 0;  // above the ellipsoid
};

// Return the Cartesian coordinates in metres: origin at the centre of the Earth, x towards longitude 0 at the equator,
// z towards the north pole (ECEF).
Eigen::Vector3d EcefFromGeodetic(const GeodeticPoint& point);
GeodeticPoint GeodeticFromEcef(const Eigen::Vector3d& point_in_ecef);

// Returns the directions to the east, to the north and upwards at a place, as columns in the axes of ECEF.
Eigen::Matrix3d EcefFromEnuRotation(const GeodeticPoint& place);

// Returns the place of a point given in metres to the east, to the north and upwards of a local origin.
GeodeticPoint GeodeticFromEnu(const GeodeticPoint& origin, const Eigen::Vector3d& point_in_enu);

}  // namespace lazyloc

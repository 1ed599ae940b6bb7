#include "colmap_lazyloc/math/geodetic.h"

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

constexpr double kMicrometre = 1e-6;
constexpr double kMicrometreDeg = 1e-11;  // of latitude

// The figures are those of pyproj 3.7.2.
struct EcefCase {
  GeodeticPoint geodetic;
  Eigen::Vector3d ecef;
};
const EcefCase kEcefCases[] = {
    {{47.3769, 8.5417, 408}, {4279227.806485565, 642719.2221466679, 4670540.878540811}},
    {{-33.5, -70.25, 2500}, {1799796.5776467773, -5012848.672390839, -3501714.1304856357}},
    {{-0.001, 151.2, -30}, {-5589177.769288944, 3072676.4805990085, -110.57375221731775}},
    {{89.999, 10, 5}, {109.99718296970656, 19.395471159484938, 6356757.313270465}},
    {{65.5, -179.99999, 8848}, {-2656000.8643124457, -0.4635595999798579, 5789100.619729291}},
    {{0, 0, 0}, {6378137, 0, 0}},
};

void ExpectNear(const GeodeticPoint& found, const GeodeticPoint& expected, double longitude_tolerance_deg) {
  EXPECT_NEAR(found.latitude_deg, expected.latitude_deg, kMicrometreDeg);
  EXPECT_NEAR(found.longitude_deg, expected.longitude_deg, longitude_tolerance_deg);
  EXPECT_NEAR(found.height_m, expected.height_m, kMicrometre);
}

TEST(Geodetic, EcefIsThatOfPyproj) {
  for (const EcefCase& point : kEcefCases) {
    EXPECT_LT((EcefFromGeodetic(point.geodetic) - point.ecef).norm(), kMicrometre);
    ExpectNear(GeodeticFromEcef(point.ecef), point.geodetic, 1e-9);
  }
}

TEST(Geodetic, EcefThereAndBackAtAnyHeight) {
  for (double latitude_deg = -90; latitude_deg <= 90; latitude_deg += 7.5) {
    for (const double height_m : {-10e3, 0.0, 10e3, 500e3, 40e6}) {
      const GeodeticPoint point = {latitude_deg, 12.5, height_m};
      ExpectNear(GeodeticFromEcef(EcefFromGeodetic(point)), point, latitude_deg * latitude_deg == 8100 ? 360 : 1e-9);
    }
  }
}

TEST(Geodetic, EnuIsThatOfPyproj) {
  const auto expect = [](const GeodeticPoint& origin, const Eigen::Vector3d& enu, const GeodeticPoint& expected) {
    ExpectNear(GeodeticFromEnu(origin, enu), expected, 1e-8);
  };
  expect({47.3769, 8.5417, 408}, {123.456, -789.01, 56.7}, {47.36980369607229, 8.543334418280534, 464.7500534420833});
  expect({-33.5, -70.25, 2500}, {-20000, 30000, 1000}, {-33.22947884691277, -70.46444751816362, 3602.0814992738888});
  expect({89.9999, 30, 0}, {5, 25, -3}, {89.99986833075668, -169.87578595519068, -2.9999492140486836});
  expect({65.5, 179.9999, 10}, {50, 0, 0}, {65.49999999615383, -179.99901989959588, 10.000195438042283});
}

}  // namespace
}  // namespace lazyloc

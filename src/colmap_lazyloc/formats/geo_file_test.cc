#include "colmap_lazyloc/formats/geo_file.h"

#include <gmock/gmock.h>

#include "colmap_lazyloc/testing/io_test.h"

namespace lazyloc {
namespace {

using ::testing::StartsWith;

using GeoFile = IoTest;

TEST_F(GeoFile, ReadsBackWithTheSameBits) {
  const GeodeticPoint origin = {47.376900000000006, -8.1, 1.0 / 3};
  WriteGeoFile(folder_ / "geo.json", origin);
  const auto read = ReadGeoFile(folder_ / "geo.json");
  ASSERT_TRUE(read.has_value());
  EXPECT_EQ(read->latitude_deg, origin.latitude_deg);
  EXPECT_EQ(read->longitude_deg, origin.longitude_deg);
  EXPECT_EQ(read->height_m, origin.height_m);
}

TEST_F(GeoFile, NeedNotExist) { EXPECT_FALSE(ReadGeoFile(folder_ / "geo.json").has_value()); }

TEST_F(GeoFile, OtherContentIsAnError) {
  const auto error = [&](const std::string& text) {
    return ErrorOf([&] { ReadGeoFile(WriteFile("geo.json", text)); });
  };
  const auto with = [](const std::string& latitude, const std::string& frame, const std::string& ellipsoid) {
    return R"({"latitude_deg":)" + latitude + R"(,"longitude_deg":8,"height_m":4,"frame":")" + frame +
           R"(","ellipsoid":")" + ellipsoid + "\"}";
  };
  EXPECT_EQ(error(with("47", "ENU", "WGS84")), "");
  EXPECT_EQ(error(with("91", "ENU", "WGS84")), "geo.json: latitude_deg is out of range");
  EXPECT_EQ(error(with("47", "NED", "WGS84")), "geo.json: frame must be ENU, but is NED");
  EXPECT_EQ(error(with("47", "ENU", "GRS80")), "geo.json: ellipsoid must be WGS84, but is GRS80");
  for (const std::string& text : {std::string(), std::string("{}"), std::string("[]"), with("\"x\"", "ENU", "WGS84")}) {
    EXPECT_THAT(error(text), StartsWith("geo.json: is not the origin of geographic coordinates")) << text;
  }
}

}  // namespace
}  // namespace lazyloc

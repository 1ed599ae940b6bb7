#include "colmap_lazyloc/results/position_files.h"

#include <cmath>
#include <limits>
#include <sstream>

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/runs/records_test_fixture.h"

namespace lazyloc {
namespace {

using Json = nlohmann::json;

QueryRecord Record(const std::string& name, QueryStatus status) {
  QueryRecord record;
  record.result.query_name = name;
  record.result.status = status;
  return record;
}

Camera Pinhole() { return {1, *CameraModelId("PINHOLE"), 640, 480, {500, 500, 320, 240}, true}; }

// Returns a query at (1, -2.5, 0.1) that looks up and is turned by 90 degrees about z.
QueryRecord Localized(const std::string& name) {
  QueryRecord record = Record(name, QueryStatus::LOCALIZED);
  const Eigen::Quaterniond rotation(std::sqrt(0.5), 0, 0, std::sqrt(0.5));
  record.result.cam_from_world = {rotation, -(rotation * Eigen::Vector3d(1, -2.5, 0.1))};
  record.result.covariance.diagonal() << 0, 0, 0, 4, 9, 16;
  record.result.confidence = 0.75;
  return record;
}

class PositionFiles : public RecordsTest {
 protected:
  // Returns the cells of the table's second line as numbers; NaN for an empty one.
  std::vector<double> Numbers(const QueryRecord& record, const WorldAxes& axes) const {
    WritePositionsCsv(folder_ / "positions.csv", Stored({record}), axes);
    std::istringstream text(ReadFile(folder_ / "positions.csv"));
    std::string line, cell;
    std::getline(text, line);
    std::getline(text, line);
    std::istringstream row(line + ',');
    std::vector<double> numbers;
    for (int i = 0; std::getline(row, cell, ','); ++i) {
      if (i >= 2) numbers.push_back(cell.empty() ? std::numeric_limits<double>::quiet_NaN() : std::stod(cell));
    }
    return numbers;
  }
};

TEST_F(PositionFiles, TableHasPositionsAndDeviationsAlongTheAxesOfTheWorld) {
  const std::vector<double> numbers = Numbers(Localized("q.jpg"), {});
  const double expected[] = {1, -2.5, 0.1, 3, 2, 4, 0.75};
  ASSERT_EQ(numbers.size(), 15);
  for (int i = 0; i < 7; ++i) EXPECT_NEAR(numbers[i], expected[i], 1e-12);
}

TEST_F(PositionFiles, TableHasNoAnglesIfTheAxesAreArbitrary) {
  const std::vector<double> numbers = Numbers(Localized("q.jpg"), {std::nullopt, /*are_arbitrary=*/true});
  ASSERT_EQ(numbers.size(), 15);
  EXPECT_NEAR(numbers[1], -2.5, 1e-12);
  for (int i = 7; i < 15; ++i) EXPECT_TRUE(std::isnan(numbers[i]));
}

TEST_F(PositionFiles, TableHasEveryQueryAndPositionsOfLocalizedOnesOnly) {
  QueryRecord doubtful = Localized("b \"1\", 2.jpg");
  doubtful.result.status = QueryStatus::LOW_CONFIDENCE;
  QueryRecord at_origin = Record("c.jpg", QueryStatus::LOCALIZED);
  at_origin.result.cam_from_world.translation = Eigen::Vector3d(-1, -0.1, -1e6);
  at_origin.result.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  WritePositionsCsv(folder_ / "positions.csv",
                    Stored({Record("a\xE9.jpg", QueryStatus::NO_PAIRS), doubtful, at_origin}), {});
  EXPECT_EQ(ReadFile(folder_ / "positions.csv"),
            "name,status,x,y,z,stddev_x,stddev_y,stddev_z,confidence,heading_deg,heading_stddev_deg,pitch_deg,"
            "pitch_stddev_deg,roll_deg,roll_stddev_deg,top_heading_deg,top_heading_stddev_deg\n"
            "a\\xe9.jpg,NO_PAIRS,,,,,,,,,,,,,,,\n"
            "\"b \"\"1\"\", 2.jpg\",LOW_CONFIDENCE,,,,,,,0.75,,,,,,,,\n"
            "c.jpg,LOCALIZED,1.0,0.1,1000000.0,,,,,0.0,,90.0,,0.0,,180.0,\n");
}

TEST_F(PositionFiles, TableHasGeographicCoordinatesIfTheOriginIsKnown) {
  const GeodeticPoint origin = {47.3769, 8.5417, 408};
  const GeodeticPoint expected = GeodeticFromEnu(origin, {1, -2.5, 0.1});
  const std::vector<double> numbers = Numbers(Localized("q.jpg"), {origin});
  ASSERT_EQ(numbers.size(), 18);
  EXPECT_NEAR(numbers[7], expected.latitude_deg, 1e-12);
  EXPECT_NEAR(numbers[8], expected.longitude_deg, 1e-12);
  EXPECT_NEAR(numbers[9], expected.height_m, 1e-8);
  EXPECT_EQ(Numbers(Record("q.jpg", QueryStatus::NO_PAIRS), {origin}).size(), 18);
}

TEST_F(PositionFiles, TableHasTheAnglesOfLocalizedQueries) {
  QueryRecord record = Localized("q.jpg");
  // Looks to the east, 10 degrees above the horizon, and is known to 0.5 degrees about each axis.
  const Eigen::Quaterniond rotation(Eigen::AngleAxisd(DegToRad(80), Eigen::Vector3d::UnitX()) *
                                    Eigen::AngleAxisd(DegToRad(90), Eigen::Vector3d::UnitZ()));
  record.result.cam_from_world.rotation = rotation;
  record.result.covariance.setZero();
  record.result.covariance.diagonal().head<3>().setConstant(DegToRad(0.5) * DegToRad(0.5));
  const std::vector<double> numbers = Numbers(record, {});
  const double c = std::cos(DegToRad(10));
  const double expected[] = {90, 0.5 / c, 10, 0.5, 0, 0.5 / c, 270, 0.5 / std::sin(DegToRad(10))};
  ASSERT_EQ(numbers.size(), 15);
  for (int i = 0; i < 8; ++i) EXPECT_NEAR(numbers[7 + i], expected[i], 1e-9) << i;
}

class PositionMap : public PositionFiles {
 protected:
  Json Write(const std::vector<QueryRecord>& records, const GeodeticPoint& origin = {47.3769, 8.5417, 408}) const {
    WritePositionsGeojson(folder_ / "positions.geojson", Stored(records), origin);
    return Json::parse(ReadFile(folder_ / "positions.geojson"));
  }
  // Returns a query that sees a scene 10 m away.
  static QueryRecord Seeing(const std::string& name) {
    QueryRecord record = Localized(name);
    record.result.query_camera = Pinhole();
    record.result.evidence.scene_distance = 10;
    return record;
  }
};

TEST_F(PositionMap, HasTheLocalizedQueries) {
  const GeodeticPoint origin = {47.3769, 8.5417, 408};
  const Json map = Write({Localized("a.jpg"), Record("b.jpg", QueryStatus::NO_PAIRS), Localized("c.jpg")});
  EXPECT_EQ(map["type"], "FeatureCollection");
  ASSERT_EQ(map["features"].size(), 2);
  const Json& feature = map["features"][1];
  EXPECT_EQ(feature["properties"]["name"], "c.jpg");
  EXPECT_NEAR(feature["properties"]["stddev_east_m"], 3, 1e-12);
  const GeodeticPoint expected = GeodeticFromEnu(origin, {1, -2.5, 0.1});
  ASSERT_EQ(feature["geometry"]["coordinates"].size(), 3);
  EXPECT_NEAR(feature["geometry"]["coordinates"][0], expected.longitude_deg, 1e-12) << "longitude is first";
  EXPECT_NEAR(feature["geometry"]["coordinates"][1], expected.latitude_deg, 1e-12);
  EXPECT_NEAR(feature["properties"]["pitch_deg"], 90, 1e-4) << "the vertical is that of the place";
  EXPECT_EQ(feature["properties"]["shows"], "position");
  EXPECT_TRUE(Write({})["features"].empty());
}

TEST_F(PositionMap, HasThePolygonOfWhatAQuerySees) {
  const Json features = Write({Localized("a.jpg"), Seeing("b.jpg")})["features"];
  ASSERT_EQ(features.size(), 3) << "without the scene's distance there is none";
  const Json& feature = features[2];
  EXPECT_EQ(feature["properties"], Json({{"name", "b.jpg"}, {"shows", "field_of_view"}}));
  EXPECT_EQ(feature["geometry"]["type"], "Polygon");
  ASSERT_EQ(feature["geometry"]["coordinates"].size(), 1);
  const Json& ring = feature["geometry"]["coordinates"][0];
  ASSERT_GE(ring.size(), 5);
  EXPECT_EQ(ring.front(), ring.back());
  const Json& centre = features[1]["geometry"]["coordinates"];
  double area = 0;
  for (size_t i = 0; i + 1 < ring.size(); ++i) {
    ASSERT_EQ(ring[i].size(), 2);
    const auto offset = [&](size_t point, int axis) {
      return ring[point][axis].get<double>() - centre[axis].get<double>();
    };
    area += (offset(i, 0) * offset(i + 1, 1) - offset(i + 1, 0) * offset(i, 1)) / 2;
    EXPECT_LT(std::abs(offset(i, 0)), 1e-4);
  }
  EXPECT_GT(area, 0) << "counterclockwise";
}

TEST_F(PositionMap, PolygonDoesNotGoAroundTheEarth) {
  const Json features = Write({Seeing("a.jpg")}, {10, 180, 0})["features"];
  const double longitude_deg = features[0]["geometry"]["coordinates"][0];
  for (const Json& point : features[1]["geometry"]["coordinates"][0]) {
    EXPECT_NEAR(point[0].get<double>(), longitude_deg, 1e-3);
  }
}

}  // namespace
}  // namespace lazyloc

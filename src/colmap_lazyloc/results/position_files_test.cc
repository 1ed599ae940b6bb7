#include "colmap_lazyloc/results/position_files.h"

#include <cmath>
#include <limits>
#include <sstream>

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

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

// Returns a query at (1, -2.5, 0.1) that is turned by 90 degrees about z.
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
  std::vector<double> Numbers(const QueryRecord& record, const std::optional<GeodeticPoint>& origin) const {
    WritePositionsCsv(folder_ / "positions.csv", Stored({record}), origin);
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
  const std::vector<double> numbers = Numbers(Localized("q.jpg"), std::nullopt);
  const double expected[] = {1, -2.5, 0.1, 3, 2, 4, 0.75};
  ASSERT_EQ(numbers.size(), 7);
  for (int i = 0; i < 7; ++i) EXPECT_NEAR(numbers[i], expected[i], 1e-12);
}

TEST_F(PositionFiles, TableHasEveryQueryAndPositionsOfLocalizedOnesOnly) {
  QueryRecord doubtful = Localized("b \"1\", 2.jpg");
  doubtful.result.status = QueryStatus::LOW_CONFIDENCE;
  QueryRecord at_origin = Record("c.jpg", QueryStatus::LOCALIZED);
  at_origin.result.cam_from_world.translation = Eigen::Vector3d(-1, -0.1, -1e6);
  at_origin.result.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  WritePositionsCsv(folder_ / "positions.csv",
                    Stored({Record("a\xE9.jpg", QueryStatus::NO_PAIRS), doubtful, at_origin}), std::nullopt);
  EXPECT_EQ(ReadFile(folder_ / "positions.csv"),
            "name,status,x,y,z,stddev_x,stddev_y,stddev_z,confidence\n"
            "a\\xe9.jpg,NO_PAIRS,,,,,,,\n"
            "\"b \"\"1\"\", 2.jpg\",LOW_CONFIDENCE,,,,,,,0.75\n"
            "c.jpg,LOCALIZED,1.0,0.1,1000000.0,,,,\n");
}

TEST_F(PositionFiles, TableHasGeographicCoordinatesIfTheOriginIsKnown) {
  const GeodeticPoint origin = {47.3769, 8.5417, 408};
  const GeodeticPoint expected = GeodeticFromEnu(origin, {1, -2.5, 0.1});
  const std::vector<double> numbers = Numbers(Localized("q.jpg"), origin);
  ASSERT_EQ(numbers.size(), 10);
  EXPECT_NEAR(numbers[7], expected.latitude_deg, 1e-12);
  EXPECT_NEAR(numbers[8], expected.longitude_deg, 1e-12);
  EXPECT_NEAR(numbers[9], expected.height_m, 1e-8);
  EXPECT_EQ(Numbers(Record("q.jpg", QueryStatus::NO_PAIRS), origin).size(), 10);
}

TEST_F(PositionFiles, MapHasTheLocalizedQueries) {
  const GeodeticPoint origin = {47.3769, 8.5417, 408};
  const auto write = [&](const std::vector<QueryRecord>& records) {
    WritePositionsGeojson(folder_ / "positions.geojson", Stored(records), origin);
    return Json::parse(ReadFile(folder_ / "positions.geojson"));
  };
  const Json map = write({Localized("a.jpg"), Record("b.jpg", QueryStatus::NO_PAIRS), Localized("c.jpg")});
  EXPECT_EQ(map["type"], "FeatureCollection");
  ASSERT_EQ(map["features"].size(), 2);
  const Json& feature = map["features"][1];
  EXPECT_EQ(feature["properties"]["name"], "c.jpg");
  EXPECT_NEAR(feature["properties"]["stddev_east_m"], 3, 1e-12);
  const GeodeticPoint expected = GeodeticFromEnu(origin, {1, -2.5, 0.1});
  ASSERT_EQ(feature["geometry"]["coordinates"].size(), 3);
  EXPECT_NEAR(feature["geometry"]["coordinates"][0], expected.longitude_deg, 1e-12) << "longitude is first";
  EXPECT_NEAR(feature["geometry"]["coordinates"][1], expected.latitude_deg, 1e-12);
  EXPECT_TRUE(write({})["features"].empty());
}

}  // namespace
}  // namespace lazyloc

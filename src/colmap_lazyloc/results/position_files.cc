#include "colmap_lazyloc/results/position_files.h"

#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "colmap_lazyloc/files/output_file.h"
#include "colmap_lazyloc/scene/format.h"
#include "colmap_lazyloc/scene/pose_distribution.h"

namespace lazyloc {
namespace {

using Json = nlohmann::ordered_json;

// Returns a cell of the table, in quotation marks if it would be taken for several cells otherwise.
std::string Cell(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string cell = "\"";
  for (const char character : text) cell += character == '"' ? "\"\"" : std::string(1, character);
  return cell + '"';
}

// Returns the standard deviations along the axes of the world; nothing if they are unknown.
std::optional<Eigen::Vector3d> AxisStddevs(const LocalizationResult& result) {
  if (!result.covariance.allFinite()) return std::nullopt;
  const Eigen::Matrix3d covariance =
      MakePoseDistribution(result.cam_from_world, result.covariance).PositionCovariance();
  return covariance.diagonal().cwiseMax(0).cwiseSqrt().eval();
}

std::string Row(const LocalizationResult& result, const std::optional<GeodeticPoint>& origin) {
  std::string row = Cell(ValidUtf8(result.query_name)) + ',' + QueryStatusName(result.status);
  const auto add = [&](const std::optional<Eigen::Vector3d>& numbers) {
    for (int i = 0; i < 3; ++i) row += ',' + (numbers ? Json((*numbers)[i]).dump() : "");
  };
  std::optional<Eigen::Vector3d> position, stddevs, place;
  if (result.status == QueryStatus::LOCALIZED) {
    position = CamInWorld(result.cam_from_world);
    stddevs = AxisStddevs(result);
    const GeodeticPoint point = origin ? GeodeticFromEnu(*origin, *position) : GeodeticPoint();
    place = {point.latitude_deg, point.longitude_deg, point.height_m};
  }
  add(position);
  add(stddevs);
  row += ',' + (result.confidence ? Json(*result.confidence).dump() : "");
  if (origin) add(place);
  return row;
}

Json Feature(const LocalizationResult& result, const GeodeticPoint& origin) {
  const GeodeticPoint point = GeodeticFromEnu(origin, CamInWorld(result.cam_from_world));
  Json properties = {{"name", ValidUtf8(result.query_name)},
                     {"confidence", result.confidence ? Json(*result.confidence) : Json()}};
  const std::optional<Eigen::Vector3d> stddevs = AxisStddevs(result);
  constexpr const char* kNames[] = {"stddev_east_m", "stddev_north_m", "stddev_up_m"};
  for (int i = 0; i < 3; ++i) properties[kNames[i]] = stddevs ? Json((*stddevs)[i]) : Json();
  return {
      {"type", "Feature"},
      {"geometry",
       {{"type", "Point"}, {"coordinates", Json::array({point.longitude_deg, point.latitude_deg, point.height_m})}}},
      {"properties", properties}};
}

}  // namespace

void WritePositionsCsv(const std::filesystem::path& path, const QueryRecords& records,
                       const std::optional<GeodeticPoint>& origin) {
  OutputFile file(path);
  file.Text() << "name,status,x,y,z,stddev_x,stddev_y,stddev_z,confidence"
              << (origin ? ",latitude_deg,longitude_deg,height_m" : "") << '\n';
  records.ForEach([&](const QueryRecord& record) { file.Text() << Row(record.result, origin) << '\n'; });
  file.Close();
}

void WritePositionsGeojson(const std::filesystem::path& path, const QueryRecords& records,
                           const GeodeticPoint& origin) {
  OutputFile file(path);
  file.Text() << R"({"type":"FeatureCollection","features":[)";
  const char* separator = "\n";
  records.ForEach([&](const QueryRecord& record) {
    if (record.result.status != QueryStatus::LOCALIZED) return;
    file.Text() << separator << Feature(record.result, origin).dump();
    separator = ",\n";
  });
  file.Text() << "\n]}\n";
  file.Close();
}

}  // namespace lazyloc

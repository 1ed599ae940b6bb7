#include "colmap_lazyloc/results/position_files.h"

#include <cmath>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "colmap_lazyloc/files/output_file.h"
#include "colmap_lazyloc/results/field_of_view.h"
#include "colmap_lazyloc/results/map_pose.h"
#include "colmap_lazyloc/scene/format.h"

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

// Returns the text of a number as it is in a table; an empty one for none.
std::string Number(const std::optional<double>& number) { return number ? Json(*number).dump() : ""; }

// Returns the standard deviations along the axes of the world; nothing if they are unknown.
std::optional<Eigen::Vector3d> AxisStddevs(const MapPose& pose) {
  if (!pose.covariance) return std::nullopt;
  return pose.covariance->diagonal().head<3>().cwiseMax(0).cwiseSqrt().eval();
}

std::string Row(const LocalizationResult& result, const WorldAxes& axes) {
  const std::optional<GeodeticPoint>& origin = axes.geographic_origin;
  std::string row = Cell(ValidUtf8(result.query_name)) + ',' + QueryStatusName(result.status);
  const auto add = [&](const std::optional<Eigen::Vector3d>& numbers) {
    for (int i = 0; i < 3; ++i) row += ',' + (numbers ? Number((*numbers)[i]) : "");
  };
  std::optional<MapPose> pose;
  std::optional<Eigen::Vector3d> position, stddevs, place;
  if (result.status == QueryStatus::LOCALIZED) {
    pose = MakeMapPose(result, axes);
    position = pose->world_from_cam.translation;
    stddevs = AxisStddevs(*pose);
    const GeodeticPoint point = origin ? GeodeticFromEnu(*origin, *position) : GeodeticPoint();
    place = {point.latitude_deg, point.longitude_deg, point.height_m};
  }
  add(position);
  add(stddevs);
  row += ',' + Number(result.confidence);
  if (origin) add(place);
  ForEachAngle(pose ? pose->angles : CameraAngles(), [&](const char*, const CameraAngle& angle) {
    row += ',' + Number(angle.deg) + ',' + Number(angle.stddev_deg);
  });
  return row;
}

Json Feature(const char* geometry, Json coordinates, Json properties) {
  return {{"type", "Feature"},
          {"geometry", {{"type", geometry}, {"coordinates", std::move(coordinates)}}},
          {"properties", std::move(properties)}};
}

// Returns what is the same in the point and in the polygon of a query.
Json Properties(const LocalizationResult& result, const char* shows) {
  return {{"name", ValidUtf8(result.query_name)}, {"shows", shows}};
}

Json PointFeature(const LocalizationResult& result, const MapPose& pose, const GeodeticPoint& origin) {
  const GeodeticPoint point = GeodeticFromEnu(origin, pose.world_from_cam.translation);
  Json properties = Properties(result, "position");
  properties["confidence"] = result.confidence ? Json(*result.confidence) : Json();
  const std::optional<Eigen::Vector3d> stddevs = AxisStddevs(pose);
  constexpr const char* kNames[] = {"stddev_east_m", "stddev_north_m", "stddev_up_m"};
  for (int i = 0; i < 3; ++i) properties[kNames[i]] = stddevs ? Json((*stddevs)[i]) : Json();
  ForEachAngle(pose.angles, [&](const std::string& name, const CameraAngle& angle) {
    properties[name + "_deg"] = *angle.deg;
    properties[name + "_stddev_deg"] = angle.stddev_deg ? Json(*angle.stddev_deg) : Json();
  });
  return Feature("Point", Json::array({point.longitude_deg, point.latitude_deg, point.height_m}), properties);
}

// Returns the polygon of what the query sees up to the median distance of its points; nothing if that is unknown.
std::optional<Json> FieldOfViewFeature(const LocalizationResult& result, const MapPose& pose,
                                       const GeodeticPoint& origin) {
  const double distance = result.evidence.scene_distance;
  if (!result.confidence || !std::isfinite(distance) || distance <= 0) return std::nullopt;
  const std::vector<Eigen::Vector3d> outline = FieldOfViewFromAbove(pose.world_from_cam, result.query_camera, distance);
  if (outline.size() < 3) return std::nullopt;
  const double longitude_deg = GeodeticFromEnu(origin, pose.world_from_cam.translation).longitude_deg;
  Json ring = Json::array();
  for (const Eigen::Vector3d& point : outline) {
    const GeodeticPoint place = GeodeticFromEnu(origin, point);
    // A polygon must not go around the Earth where longitudes jump from 180 to -180 degrees.
    const double offset_deg = std::remainder(place.longitude_deg - longitude_deg, 360.0);
    ring.push_back({longitude_deg + offset_deg, place.latitude_deg});
  }
  ring.push_back(ring.front());
  return Feature("Polygon", Json::array({ring}), Properties(result, "field_of_view"));
}

}  // namespace

void WritePositionsCsv(const std::filesystem::path& path, const QueryRecords& records, const WorldAxes& axes) {
  OutputFile file(path);
  file.Text() << "name,status,x,y,z,stddev_x,stddev_y,stddev_z,confidence"
              << (axes.geographic_origin ? ",latitude_deg,longitude_deg,height_m" : "");
  ForEachAngle(CameraAngles(), [&](const std::string& name, const CameraAngle&) {
    file.Text() << ',' << name << "_deg," << name << "_stddev_deg";
  });
  file.Text() << '\n';
  records.ForEach([&](const QueryRecord& record) { file.Text() << Row(record.result, axes) << '\n'; });
  file.Close();
}

void WritePositionsGeojson(const std::filesystem::path& path, const QueryRecords& records,
                           const GeodeticPoint& origin) {
  OutputFile file(path);
  file.Text() << R"({"type":"FeatureCollection","features":[)";
  const char* separator = "\n";
  records.ForEach([&](const QueryRecord& record) {
    if (record.result.status != QueryStatus::LOCALIZED) return;
    const MapPose pose = MakeMapPose(record.result, {origin});
    file.Text() << separator << PointFeature(record.result, pose, origin).dump();
    separator = ",\n";
    if (const auto view = FieldOfViewFeature(record.result, pose, origin)) file.Text() << separator << view->dump();
  });
  file.Text() << "\n]}\n";
  file.Close();
}

}  // namespace lazyloc

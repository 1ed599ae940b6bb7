#include "colmap_lazyloc/formats/geo_file.h"

#include <cmath>
#include <fstream>
#include <string>

#include <nlohmann/json.hpp>

#include "colmap_lazyloc/files/output_file.h"
#include "colmap_lazyloc/files/paths.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

using Json = nlohmann::ordered_json;

constexpr char kArbitraryAxesText[] =
    "No axis of this model is known to point up, so results have no heading, pitch and roll.";

void CheckWord(const Json& json, const char* key, const std::string& expected) {
  const std::string found = json.at(key).get<std::string>();
  if (found != expected) throw InputError(std::string(key) + " must be " + expected + ", but is " + found);
}

double ReadNumber(const Json& json, const char* key, double maximum) {
  const double number = json.at(key).get<double>();
  if (!(std::abs(number) <= maximum)) throw InputError(std::string(key) + " is out of range");
  return number;
}

}  // namespace

std::optional<GeodeticPoint> ReadGeoFile(const std::filesystem::path& path) {
  if (!IsTaken(path)) return std::nullopt;
  std::ifstream file(path);
  if (!file) throw InputError(path.string() + ": cannot be read");
  try {
    const Json json = Json::parse(file);
    CheckWord(json, "frame", "ENU");
    CheckWord(json, "ellipsoid", "WGS84");
    return GeodeticPoint{ReadNumber(json, "latitude_deg", 90), ReadNumber(json, "longitude_deg", 360),
                         json.at("height_m").get<double>()};
  } catch (const Json::exception& error) {
    throw InputError(path.string() + ": is not the origin of geographic coordinates: " + error.what());
  } catch (const InputError& error) {
    throw InputError(path.string() + ": " + error.what());
  }
}

void WriteGeoFile(const std::filesystem::path& path, const GeodeticPoint& origin) {
  const Json json = {{"latitude_deg", origin.latitude_deg},
                     {"longitude_deg", origin.longitude_deg},
                     {"height_m", origin.height_m},
                     {"frame", "ENU"},
                     {"ellipsoid", "WGS84"}};
  OutputFile file(path);
  file.Text() << json.dump(2) << '\n';
  file.Close();
}

WorldAxes ReadAxes(const std::filesystem::path& folder) {
  return {ReadGeoFile(folder / kGeoFile), IsTaken(folder / kArbitraryAxesFile)};
}

void WriteAxes(const std::filesystem::path& folder, const WorldAxes& axes) {
  if (axes.geographic_origin) WriteGeoFile(folder / kGeoFile, *axes.geographic_origin);
  if (!axes.are_arbitrary) return;
  OutputFile file(folder / kArbitraryAxesFile);
  file.Text() << kArbitraryAxesText << '\n';
  file.Close();
}

}  // namespace lazyloc

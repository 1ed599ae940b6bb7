#include "colmap_lazyloc/formats/localized_results.h"

#include <algorithm>
#include <fstream>
#include <string>

#include <nlohmann/json.hpp>

#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/pose_distribution.h"

namespace lazyloc {
namespace {

using Json = nlohmann::json;

template <typename Enum>
void ReadEnum(const Json& name, Enum* value) {
  const auto& names = kEnumNames<Enum>;
  const auto found = std::find(names.begin(), names.end(), name.get<std::string>());
  if (found == names.end()) throw std::out_of_range("unknown value");
  *value = static_cast<Enum>(found - names.begin());
}

Rigid3d ReadPose(const Json& json) {
  const Json& q = json.at("qvec");
  const Json& t = json.at("tvec");
  return {Eigen::Quaterniond(q.at(0).get<double>(), q.at(1), q.at(2), q.at(3)),
          Eigen::Vector3d(t.at(0), t.at(1), t.at(2))};
}

// Returns false for null.
bool ReadMatrix(const Json& json, Eigen::Matrix<double, 6, 6>* matrix) {
  if (json.is_null()) return false;
  for (int row = 0; row < 6; ++row) {
    for (int col = 0; col < 6; ++col) (*matrix)(row, col) = json.at(row).at(col);
  }
  return true;
}

LocalizationResult ReadResult(const Json& json) {
  LocalizationResult result;
  result.query_name = json.at("name");
  ReadEnum(json.at("status"), &result.status);
  result.reason = json.value("reason", "");
  result.start = json.value("start", "");
  if (!json.at("confidence").is_null()) {
    result.confidence = json.at("confidence").get<double>();
    const Json& evidence = json.at("evidence");
    ForEachEvidence(result.evidence, [&](const char* name, double* value) {
      if (!evidence.at(name).is_null()) *value = evidence.at(name);
    });
  }
  if (json.contains("intrinsics")) {
    const Json& intrinsics = json.at("intrinsics");
    ReadEnum(intrinsics.at("origin"), &result.intrinsics.origin);
    ReadEnum(intrinsics.at("verdict"), &result.intrinsics.verdict);
    ReadMatrix(intrinsics.value("covariance", Json()), &result.intrinsics.covariance);
    if (!intrinsics.at("focal_factor").is_null()) {
      intrinsics.at("focal_factor").get_to(result.intrinsics.focal_factor);
      intrinsics.at("focal_factor_stddev").get_to(result.intrinsics.focal_factor_stddev);
    }
  }
  const char* pose = result.status == QueryStatus::LOCALIZED ? "cam_from_world" : "unconfirmed_cam_from_world";
  if (!HasPose(result.status)) return result;
  result.cam_from_world = ReadPose(json.at(pose));
  result.is_camera_refined = json.contains("camera");
  if (!ReadMatrix(json.at("covariance"), &result.covariance)) return result;
  result.spread = MakePoseDistribution(result.cam_from_world, result.covariance).Spread();
  return result;
}

}  // namespace

std::vector<LocalizationResult> ReadLocalizedResults(const std::filesystem::path& folder) {
  const std::filesystem::path path = folder / kResultsFile;
  std::ifstream file(path);
  if (!file) throw InputError(path.string() + ": cannot be read (is it the output folder of colmap lazy_localizer?)");
  std::vector<LocalizationResult> results;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    try {
      results.push_back(ReadResult(Json::parse(line)));
    } catch (const std::exception&) {
      throw InputError(path.string() + ":" + std::to_string(number) + ": is not a result of colmap lazy_localizer");
    }
  }
  if (results.empty()) throw InputError(path.string() + ": has no results");
  std::sort(results.begin(), results.end(),
            [](const LocalizationResult& a, const LocalizationResult& b) { return a.query_name < b.query_name; });
  const Model model = ReadModel(folder / "model");
  for (LocalizationResult& result : results) {
    if (result.status != QueryStatus::LOCALIZED) continue;
    const ModelImage* image = FindByName(model.images, result.query_name);
    if (image == nullptr) {
      throw InputError((folder / "model").string() + ": has no image " + result.query_name + ", which " +
                       path.string() + " says is localized");
    }
    result.query_camera = model.cameras.at(image->camera_id);
  }
  return results;
}

std::set<std::string> ReadNamesOfResults(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::set<std::string> names;
  for (std::string line; std::getline(file, line);) {
    const Json json = Json::parse(line, nullptr, /*allow_exceptions=*/false);
    const auto name = json.find("name");
    if (name != json.end() && name->is_string()) names.insert(name->get<std::string>());
  }
  return names;
}

}  // namespace lazyloc

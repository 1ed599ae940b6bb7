#include "colmap_lazyloc/formats/trajectory.h"

#include <optional>

#include "colmap_lazyloc/files/text_file.h"
#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

Rigid3d PoseOf(const TextFile& file, const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation) {
  if (!IsUnitQuaternion(rotation) || !translation.allFinite()) {
    throw file.Error("the pose is not a unit quaternion with a translation");
  }
  return {rotation.normalized(), translation};
}

}  // namespace

std::map<std::string, Rigid3d> ReadTrajectory(const std::filesystem::path& path,
                                              const std::vector<std::string>& query_names) {
  std::map<std::string, Rigid3d> poses;
  if (std::filesystem::is_directory(path)) {
    for (const ModelImage& image : ReadModel(path).images) {
      poses[image.name] = {image.cam_from_world.rotation.normalized(), image.cam_from_world.translation};
    }
    return poses;
  }
  std::map<double, std::vector<std::string>> names_of_timestamp;
  for (const std::string& name : query_names) {
    const auto timestamp = NumberFrom<double>(std::filesystem::path(name).stem().string());
    if (timestamp) names_of_timestamp[*timestamp].push_back(name);
  }
  TextFile file(path);
  const auto add = [&](const std::string& name, const Rigid3d& pose) {
    if (!poses.emplace(name, pose).second) throw file.Error("a second pose of " + name);
  };
  while (file.NextEntry()) {
    std::string_view rest = file.Line();
    const std::string first(NextWord(&rest));
    double v[7];
    for (double& number : v) number = file.ParseNumber<double>(NextWord(&rest));
    if (!NextWord(&rest).empty()) throw file.Error("more than eight words");
    const std::optional<double> timestamp = NumberFrom<double>(first);
    if (!timestamp) {
      add(first, PoseOf(file, {v[0], v[1], v[2], v[3]}, {v[4], v[5], v[6]}));
      continue;
    }
    const Rigid3d cam_from_world = Inverse(PoseOf(file, {v[6], v[3], v[4], v[5]}, {v[0], v[1], v[2]}));
    const auto names = names_of_timestamp.find(*timestamp);
    if (names == names_of_timestamp.end()) continue;  // between the queries
    if (names->second.size() > 1)
      throw file.Error("both " + names->second[0] + " and " + names->second[1] + " have this timestamp");
    add(names->second.front(), cam_from_world);
  }
  return poses;
}

}  // namespace lazyloc

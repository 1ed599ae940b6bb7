#include "colmap_lazyloc/formats/trajectory.h"

#include <optional>

#include "colmap_lazyloc/files/text_file.h"
#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

// Returns an image's file name, without folders and extension, as a number; nullopt if it is not one.
std::optional<double> Timestamp(const std::string& image_name) {
  return NumberFrom<double>(std::filesystem::path(image_name).stem().string());
}

Rigid3d PoseOf(const TextFile& file, const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation) {
  if (!IsUnitQuaternion(rotation) || !translation.allFinite()) {
    throw file.Error("the pose is not a unit quaternion with a translation");
  }
  return {rotation.normalized(), translation};
}

std::map<std::string, Rigid3d> ReadModelTrajectory(const std::filesystem::path& path) {
  std::map<std::string, Rigid3d> poses;
  for (const ModelImage& image : ReadModel(path).images) {
    poses[image.name] = {image.cam_from_world.rotation.normalized(), image.cam_from_world.translation};
  }
  return poses;
}

}  // namespace

std::map<std::string, Rigid3d> ReadTrajectory(const std::filesystem::path& path,
                                              const std::vector<std::string>& query_names) {
  if (std::filesystem::is_directory(path)) return ReadModelTrajectory(path);
  std::map<double, std::vector<std::string>> names_of_timestamp;
  for (const std::string& name : query_names) {
    if (const auto timestamp = Timestamp(name)) names_of_timestamp[*timestamp].push_back(name);
  }
  std::map<std::string, Rigid3d> poses;
  const auto add = [&](const TextFile& file, const std::string& name, const Rigid3d& pose) {
    if (!poses.emplace(name, pose).second) throw file.Error("a second pose of " + name);
  };
  TextFile file(path);
  while (file.NextEntry()) {
    std::string_view rest = file.Line();
    const std::string first(NextWord(&rest));
    double v[7];
    for (double& number : v) number = file.ParseNumber<double>(NextWord(&rest));
    if (!NextWord(&rest).empty()) throw file.Error("more than eight words");
    const std::optional<double> timestamp = NumberFrom<double>(first);
    if (!timestamp) {
      add(file, first, PoseOf(file, {v[0], v[1], v[2], v[3]}, {v[4], v[5], v[6]}));
      continue;
    }
    const Rigid3d cam_from_world = Inverse(PoseOf(file, {v[6], v[3], v[4], v[5]}, {v[0], v[1], v[2]}));
    const auto names = names_of_timestamp.find(*timestamp);
    if (names == names_of_timestamp.end()) continue;  // between the queries
    if (names->second.size() > 1)
      throw file.Error("both " + names->second[0] + " and " + names->second[1] + " have this timestamp");
    add(file, names->second.front(), cam_from_world);
  }
  return poses;
}

}  // namespace lazyloc

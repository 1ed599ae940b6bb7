#include "colmap_lazyloc/formats/rig_config.h"

#include <fstream>

#include <nlohmann/json.hpp>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

using Json = nlohmann::json;

Rigid3d ReadSensorPose(const Json& camera, const std::string& label) {
  if (!camera.contains("cam_from_rig_rotation") || !camera.contains("cam_from_rig_translation")) {
    throw InputError(label + ": has no pose in the rig (cam_from_rig_rotation and cam_from_rig_translation)");
  }
  const auto q = camera["cam_from_rig_rotation"].get<std::vector<double>>();
  const auto t = camera["cam_from_rig_translation"].get<std::vector<double>>();
  if (q.size() != 4) throw InputError(label + ": cam_from_rig_rotation must be four numbers (w, x, y, z)");
  if (t.size() != 3) throw InputError(label + ": cam_from_rig_translation must be three numbers");
  const Eigen::Quaterniond rotation(q[0], q[1], q[2], q[3]);
  if (!IsUnitQuaternion(rotation)) throw InputError(label + ": cam_from_rig_rotation is not a unit quaternion");
  return {rotation.normalized(), {t[0], t[1], t[2]}};
}

RigCameras ReadRig(const Json& rig, const std::string& label) {
  RigCameras cameras;
  bool has_reference = false;
  for (const Json& camera : rig.at("cameras")) {
    const std::string prefix = camera.at("image_prefix").get<std::string>();
    const std::string camera_label = label + ", camera '" + prefix + "'";
    for (const RigCamera& other : cameras) {
      if (other.image_prefix == prefix) throw InputError(camera_label + ": is listed twice");
    }
    const bool is_reference = camera.value("ref_sensor", false);
    if (is_reference && has_reference) throw InputError(camera_label + ": is a second reference sensor (ref_sensor)");
    has_reference = has_reference || is_reference;
    cameras.push_back({prefix, is_reference ? Rigid3d() : ReadSensorPose(camera, camera_label)});
  }
  if (!has_reference) throw InputError(label + ": no camera has ref_sensor");
  return cameras;
}

}  // namespace

std::vector<RigCameras> ReadRigConfig(const std::filesystem::path& path) {
  std::ifstream file(path);
  if (!file) throw InputError(path.string() + ": cannot be read");
  try {
    std::vector<RigCameras> rigs;
    for (const Json& rig : Json::parse(file)) {
      rigs.push_back(ReadRig(rig, path.string() + ": rig " + std::to_string(rigs.size() + 1)));
    }
    if (rigs.empty()) throw InputError(path.string() + ": contains no rig");
    return rigs;
  } catch (const Json::exception& error) {
    throw InputError(path.string() + ": is not a rig configuration: " + error.what());
  }
}

}  // namespace lazyloc

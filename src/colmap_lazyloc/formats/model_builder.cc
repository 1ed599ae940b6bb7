#include "colmap_lazyloc/formats/model_builder.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"

namespace lazyloc {
namespace {

bool IsUsablePose(const Rigid3d& pose) {
  const double norm = pose.rotation.norm();
  return std::isfinite(norm) && norm > 0 && pose.translation.allFinite();
}

}  // namespace

std::string ModelBuilder::Add(const Camera& camera) {
  const std::string label = "camera " + std::to_string(camera.camera_id);
  if (const std::string problem = CameraProblem(camera); !problem.empty()) return label + ": " + problem;
  if (!model_.cameras.emplace(camera.camera_id, camera).second) return label + " appears twice";
  return "";
}

std::string ModelBuilder::Add(const Rig& rig) {
  const std::string label = "rig " + std::to_string(rig.rig_id);
  for (const Sensor& sensor : SensorsOf(rig)) {
    if (sensor.type == SensorType::CAMERA && model_.cameras.count(sensor.sensor_id) == 0) {
      return label + ": its camera " + std::to_string(sensor.sensor_id) + " is missing";
    }
  }
  for (const RigSensor& other : rig.others) {
    if (other.sensor_from_rig && !IsUsablePose(*other.sensor_from_rig)) {
      return label + ": the pose of a sensor is not finite, or its quaternion is zero";
    }
  }
  if (!model_.rigs.emplace(rig.rig_id, rig).second) return label + " appears twice";
  return "";
}

std::string ModelBuilder::Add(const ModelFrame& frame) {
  const std::string label = "frame " + std::to_string(frame.frame_id);
  if (!IsUsablePose(frame.rig_from_world)) return label + ": the pose is not finite, or its quaternion is zero";
  const auto rig = model_.rigs.find(frame.rig_id);
  if (rig == model_.rigs.end()) return label + ": its rig " + std::to_string(frame.rig_id) + " is missing";
  const std::vector<Sensor> sensors = SensorsOf(rig->second);
  for (const FrameData& data : frame.data) {
    if (data.sensor.type != SensorType::CAMERA) continue;
    const std::string image = label + ": image " + std::to_string(data.data_id);
    if (std::find(sensors.begin(), sensors.end(), data.sensor) == sensors.end()) {
      return image + " is of camera " + std::to_string(data.sensor.sensor_id) + ", which is not of the frame's rig";
    }
    if (!camera_of_framed_image_.emplace(data.data_id, data.sensor.sensor_id).second) return image + " appears twice";
  }
  if (!model_.frames.emplace(frame.frame_id, frame).second) return label + " appears twice";
  return "";
}

std::string ModelBuilder::Add(ModelImage image) {
  const auto label = [&] { return "image " + std::to_string(image.image_id) + " ('" + image.name + "')"; };
  if (image.name.empty()) return label() + " has no name";
  if (!IsUsablePose(image.cam_from_world)) return label() + ": the pose is not finite, or its quaternion is zero";
  if (model_.cameras.count(image.camera_id) == 0) {
    return label() + ": its camera " + std::to_string(image.camera_id) + " is missing";
  }
  const auto framed = camera_of_framed_image_.find(image.image_id);
  if (!(model_.rigs.empty() && model_.frames.empty()) &&
      (framed == camera_of_framed_image_.end() || framed->second != image.camera_id)) {
    return label() + " is in no frame with its camera " + std::to_string(image.camera_id) +
           ": the files of rigs and frames beside it are of another model; without them it can be read";
  }
  if (!image_ids_.insert(image.image_id).second) return label() + ": its id appears twice";
  if (!names_.insert(image.name).second) return label() + ": its name appears twice";
  model_.images.push_back(std::move(image));
  return "";
}

Model ModelBuilder::Take() {
  std::sort(model_.images.begin(), model_.images.end(),
            [](const ModelImage& a, const ModelImage& b) { return a.name < b.name; });
  return std::move(model_);
}

}  // namespace lazyloc

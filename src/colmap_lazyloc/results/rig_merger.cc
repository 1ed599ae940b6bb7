#include <algorithm>

#include "colmap_lazyloc/results/model_merger.h"
#include "colmap_lazyloc/scene/free_ids.h"

namespace lazyloc {

namespace {

// Notes the cameras of a rig whose pose on it is known, unless an earlier rig has them.
void NoteCameras(const Rig& rig, MergedModel* merged) {
  for (const Sensor& sensor : SensorsOf(rig)) {
    if (sensor.type == SensorType::CAMERA && SensorFromRig(rig, sensor)) {
      merged->rig_of_camera.emplace(sensor.sensor_id, rig.rig_id);
    }
  }
}

}  // namespace

void KeepRigs(const Model& model, MergedModel* merged) {
  merged->rigs = model.rigs;
  for (const auto& [rig_id, rig] : merged->rigs) NoteCameras(rig, merged);
  for (const auto& [frame_id, frame] : model.frames) {
    ModelFrame kept = frame;
    const auto is_gone = [&](const FrameData& data) {
      const MergedImage image{static_cast<uint32_t>(data.data_id)};
      return data.sensor.type == SensorType::CAMERA &&
             !std::binary_search(merged->images.begin(), merged->images.end(), image);
    };
    kept.data.erase(std::remove_if(kept.data.begin(), kept.data.end(), is_gone), kept.data.end());
    const auto is_image = [](const FrameData& data) { return data.sensor.type == SensorType::CAMERA; };
    if (std::any_of(kept.data.begin(), kept.data.end(), is_image)) merged->frames.emplace(frame_id, std::move(kept));
  }
}

void AddFrameOfOneImage(const ModelImage& image, MergedModel* merged) {
  const Sensor camera{SensorType::CAMERA, image.camera_id};
  ModelFrame frame;
  frame.frame_id = FreeId(image.image_id, merged->frames);
  frame.rig_from_world = image.cam_from_world;
  frame.data = {{camera, image.image_id}};
  const auto rig_of_camera = merged->rig_of_camera.find(image.camera_id);
  if (rig_of_camera == merged->rig_of_camera.end()) {
    frame.rig_id = FreeId(image.camera_id, merged->rigs);
    const Rig added = {frame.rig_id, camera, {}};
    merged->rigs.emplace(frame.rig_id, added);
    NoteCameras(added, merged);
  } else {
    frame.rig_id = rig_of_camera->second;
    const Rig& rig = merged->rigs.at(frame.rig_id);
    Rigid3d cam_from_rig = *SensorFromRig(rig, camera);
    cam_from_rig.rotation.normalize();
    // Keeps the bits of the reference camera's pose, which is the rig's.
    if (rig.reference != camera) frame.rig_from_world = Inverse(cam_from_rig) * image.cam_from_world;
  }
  merged->frames.emplace(frame.frame_id, std::move(frame));
}

}  // namespace lazyloc

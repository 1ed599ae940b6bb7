#include "colmap_lazyloc/io/rig_merger.h"

#include <algorithm>

#include "colmap_lazyloc/io/free_ids.h"

namespace lazyloc {

void KeepRigs(const Model& model, MergedModel* merged) {
  merged->rigs = model.rigs;
  for (const auto& [frame_id, frame] : model.frames) {
    ModelFrame kept = frame;
    const auto is_gone = [&](const FrameData& data) {
      return data.sensor.type == SensorType::CAMERA && merged->images.count(static_cast<uint32_t>(data.data_id)) == 0;
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
  const auto rig = std::find_if(merged->rigs.begin(), merged->rigs.end(),
                                [&](const auto& entry) { return SensorFromRig(entry.second, camera).has_value(); });
  if (rig == merged->rigs.end()) {
    frame.rig_id = FreeId(image.camera_id, merged->rigs);
    merged->rigs.emplace(frame.rig_id, Rig{frame.rig_id, camera, {}});
  } else {
    frame.rig_id = rig->first;
    Rigid3d cam_from_rig = *SensorFromRig(rig->second, camera);
    cam_from_rig.rotation.normalize();
    // Keeps the bits of the reference camera's pose, which is the rig's.
    if (rig->second.reference != camera) frame.rig_from_world = Inverse(cam_from_rig) * image.cam_from_world;
  }
  merged->frames.emplace(frame.frame_id, std::move(frame));
}

}  // namespace lazyloc

#include "colmap_lazyloc/bridge/database_writing.h"

namespace lazyloc {

std::shared_ptr<colmap::Database> OpenDatabase(const std::filesystem::path& path) {
  return colmap::Database::Open(path);
}

bool CanWriteDescriptors(FeatureType) { return true; }

void WriteDescriptors(uint32_t image_id, const Features& features, colmap::Database* database) {
  database->WriteDescriptors(image_id,
                             {static_cast<colmap::FeatureExtractorType>(features.type), features.descriptors});
}

void WriteRigOf(const colmap::Camera& camera, colmap::Database* database) {
  colmap::Rig rig;
  rig.SetRigId(camera.camera_id);
  rig.AddRefSensor(camera.SensorId());
  database->WriteRig(rig, /*use_rig_id=*/true);
}

void WriteFrameOf(const colmap::Image& image, colmap::Database* database) {
  colmap::Frame frame;
  frame.SetFrameId(image.ImageId());
  frame.SetRigId(image.CameraId());
  frame.AddDataId(image.DataId());
  database->WriteFrame(frame, /*use_frame_id=*/true);
}

}  // namespace lazyloc

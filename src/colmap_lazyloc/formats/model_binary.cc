#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/files/binary_file.h"
#include "colmap_lazyloc/files/paths.h"
#include "colmap_lazyloc/formats/model_formats.h"

namespace lazyloc {
namespace {

Camera ReadCamera(BinaryFile* file) {
  Camera camera;
  camera.camera_id = file->Read<uint32_t>();
  camera.model_id = file->Read<int32_t>();
  camera.width = file->Read<uint64_t>();
  camera.height = file->Read<uint64_t>();
  camera.params.resize(CameraModelNumParams(camera.model_id));  // the format does not store their number
  for (double& param : camera.params) param = file->Read<double>();
  return camera;
}

Rigid3d ReadPose(BinaryFile* file) {
  Rigid3d pose;
  for (double* number : {&pose.rotation.w(), &pose.rotation.x(), &pose.rotation.y(), &pose.rotation.z(),
                         &pose.translation.x(), &pose.translation.y(), &pose.translation.z()}) {
    *number = file->Read<double>();
  }
  return pose;
}

Sensor ReadSensor(BinaryFile* file) {
  const int32_t type = file->Read<int32_t>();
  if (type != static_cast<int32_t>(SensorType::CAMERA) && type != static_cast<int32_t>(SensorType::IMU)) {
    throw file->Error("unknown sensor type " + std::to_string(type));
  }
  return {static_cast<SensorType>(type), file->Read<uint32_t>()};
}

Rig ReadRig(BinaryFile* file) {
  Rig rig;
  rig.rig_id = file->Read<uint32_t>();
  const uint32_t num_sensors = file->Read<uint32_t>();
  if (num_sensors > 0) rig.reference = ReadSensor(file);
  for (uint32_t i = 1; i < num_sensors; ++i) {
    RigSensor other{ReadSensor(file), std::nullopt};
    if (file->Read<uint8_t>() != 0) other.sensor_from_rig = ReadPose(file);
    rig.others.push_back(other);
  }
  return rig;
}

ModelFrame ReadFrame(BinaryFile* file) {
  ModelFrame frame;
  frame.frame_id = file->Read<uint32_t>();
  frame.rig_id = file->Read<uint32_t>();
  frame.rig_from_world = ReadPose(file);
  const uint32_t num_data = file->Read<uint32_t>();
  for (uint32_t i = 0; i < num_data; ++i) {
    const Sensor sensor = ReadSensor(file);
    frame.data.push_back({sensor, file->Read<uint64_t>()});
  }
  return frame;
}

ModelImage ReadImage(BinaryFile* file) {
  ModelImage image;
  image.image_id = file->Read<uint32_t>();
  image.cam_from_world = ReadPose(file);
  image.camera_id = file->Read<uint32_t>();
  image.name = file->ReadName();
  file->Skip(file->ReadCount() * (2 * sizeof(double) + sizeof(uint64_t)));  // points: x, y and id
  return image;
}

template <typename Record>
void ReadRecords(const std::filesystem::path& path, Record (*read)(BinaryFile*), ModelBuilder* builder) {
  BinaryFile file(path);
  for (uint64_t i = file.ReadCount(); i > 0; --i) {
    if (const std::string problem = builder->Add(read(&file)); !problem.empty()) throw file.Error(problem);
  }
  file.CheckEnd();
}

}  // namespace

void ReadBinaryModel(const std::filesystem::path& folder, ModelBuilder* builder) {
  ReadRecords(folder / "cameras.bin", ReadCamera, builder);
  if (IsTaken(folder / "rigs.bin")) ReadRecords(folder / "rigs.bin", ReadRig, builder);
  if (IsTaken(folder / "frames.bin")) ReadRecords(folder / "frames.bin", ReadFrame, builder);
  ReadRecords(folder / "images.bin", ReadImage, builder);
}

}  // namespace lazyloc

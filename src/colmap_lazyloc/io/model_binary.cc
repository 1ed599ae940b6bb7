#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/io/binary_file.h"
#include "colmap_lazyloc/io/model_formats.h"

namespace lazyloc {
namespace {

constexpr uint64_t kMinCameraBytes = 4 + 4 + 8 + 8;
constexpr uint64_t kMinImageBytes = 4 + 7 * 8 + 4 + 1 + 8;
constexpr uint64_t kPointBytes = 3 * 8;

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

ModelImage ReadImage(BinaryFile* file) {
  ModelImage image;
  image.image_id = file->Read<uint32_t>();
  Rigid3d& pose = image.cam_from_world;
  for (double* number : {&pose.rotation.w(), &pose.rotation.x(), &pose.rotation.y(), &pose.rotation.z(),
                         &pose.translation.x(), &pose.translation.y(), &pose.translation.z()}) {
    *number = file->Read<double>();
  }
  image.camera_id = file->Read<uint32_t>();
  image.name = file->ReadName();
  file->Skip(file->ReadCount(kPointBytes) * kPointBytes);
  return image;
}

}  // namespace

void ReadCamerasBinary(const std::filesystem::path& path, ModelBuilder* builder) {
  BinaryFile file(path);
  const uint64_t num_cameras = file.ReadCount(kMinCameraBytes);
  for (uint64_t i = 0; i < num_cameras; ++i) {
    if (const std::string problem = builder->AddCamera(ReadCamera(&file)); !problem.empty()) throw file.Error(problem);
  }
  file.CheckEnd();
}

void ReadImagesBinary(const std::filesystem::path& path, ModelBuilder* builder) {
  BinaryFile file(path);
  const uint64_t num_images = file.ReadCount(kMinImageBytes);
  for (uint64_t i = 0; i < num_images; ++i) {
    if (const std::string problem = builder->AddImage(ReadImage(&file)); !problem.empty()) throw file.Error(problem);
  }
  file.CheckEnd();
}

}  // namespace lazyloc

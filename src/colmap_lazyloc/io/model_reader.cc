#include "colmap_lazyloc/io/model_reader.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/io/model_formats.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

bool IsUsablePose(const Rigid3d& pose) {
  const double norm = pose.rotation.norm();
  return std::isfinite(norm) && norm > 0 && pose.translation.allFinite();
}

bool HaveFiles(const std::filesystem::path& cameras, const std::filesystem::path& images) {
  std::error_code ignored;
  return std::filesystem::exists(cameras, ignored) && std::filesystem::exists(images, ignored);
}

}  // namespace

std::string ModelBuilder::AddCamera(Camera camera) {
  const std::string label = "camera " + std::to_string(camera.camera_id);
  if (const std::string problem = CameraProblem(camera); !problem.empty()) return label + ": " + problem;
  const uint32_t camera_id = camera.camera_id;
  if (!model_.cameras.emplace(camera_id, std::move(camera)).second) return label + " appears twice";
  return "";
}

std::string ModelBuilder::AddImage(ModelImage image) {
  const std::string label = "image " + std::to_string(image.image_id) + " ('" + image.name + "')";
  if (image.name.empty()) return label + " has no name";
  if (!IsUsablePose(image.cam_from_world)) return label + ": the pose is not finite, or its quaternion is zero";
  if (model_.cameras.count(image.camera_id) == 0) {
    return label + ": its camera " + std::to_string(image.camera_id) + " is missing";
  }
  if (!image_ids_.insert(image.image_id).second) return label + ": its id appears twice";
  if (!names_.insert(image.name).second) return label + ": its name appears twice";
  model_.images.push_back(std::move(image));
  return "";
}

Model ModelBuilder::Take() {
  std::sort(model_.images.begin(), model_.images.end(),
            [](const ModelImage& a, const ModelImage& b) { return a.name < b.name; });
  Model model = std::exchange(model_, {});
  image_ids_.clear();
  names_.clear();
  return model;
}

Model ReadModel(const std::filesystem::path& path) {
  ModelBuilder builder;
  std::filesystem::path images_path;
  if (HaveFiles(path / "cameras.bin", images_path = path / "images.bin")) {
    ReadCamerasBinary(path / "cameras.bin", &builder);
    ReadImagesBinary(images_path, &builder);
  } else if (HaveFiles(path / "cameras.txt", images_path = path / "images.txt")) {
    ReadCamerasText(path / "cameras.txt", &builder);
    ReadImagesText(images_path, &builder);
  } else {
    throw InputError(path.string() +
                     ": holds no COLMAP model: neither cameras.bin and images.bin nor cameras.txt and images.txt");
  }
  Model model = builder.Take();
  if (model.images.empty()) throw InputError(images_path.string() + ": holds no posed image");
  return model;
}

}  // namespace lazyloc

#include <string_view>
#include <type_traits>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/files/paths.h"
#include "colmap_lazyloc/files/text_file.h"
#include "colmap_lazyloc/formats/model_formats.h"

namespace lazyloc {
namespace {

Camera ParseCameraLine(const TextFile& file) {
  std::string_view rest = file.Line();
  const auto camera_id = file.ParseNumber<uint32_t>(NextWord(&rest));
  const std::string model_name(NextWord(&rest));
  const std::optional<int> model_id = CameraModelId(model_name);
  if (!model_id) throw file.Error("unknown camera model '" + model_name + "'");
  Camera camera = ParseCamera(*model_id, rest, file);
  camera.camera_id = camera_id;
  return camera;
}

Rigid3d ParsePose(const TextFile& file, std::string_view* rest) {
  Rigid3d pose;
  for (double* number : {&pose.rotation.w(), &pose.rotation.x(), &pose.rotation.y(), &pose.rotation.z(),
                         &pose.translation.x(), &pose.translation.y(), &pose.translation.z()}) {
    *number = file.ParseNumber<double>(NextWord(rest));
  }
  return pose;
}

Sensor ParseSensor(const TextFile& file, std::string_view* rest) {
  const std::string type(NextWord(rest));
  if (type != "CAMERA" && type != "IMU") throw file.Error("unknown sensor type '" + type + "'");
  return {type == "CAMERA" ? SensorType::CAMERA : SensorType::IMU, file.ParseNumber<uint32_t>(NextWord(rest))};
}

Rig ParseRig(const TextFile& file) {
  std::string_view rest = file.Line();
  Rig rig;
  rig.rig_id = file.ParseNumber<uint32_t>(NextWord(&rest));
  const uint32_t num_sensors = file.ParseNumber<uint32_t>(NextWord(&rest));
  if (num_sensors > 0) rig.reference = ParseSensor(file, &rest);
  for (uint32_t i = 1; i < num_sensors; ++i) {
    RigSensor other{ParseSensor(file, &rest), std::nullopt};
    if (file.ParseNumber<int>(NextWord(&rest)) != 0) other.sensor_from_rig = ParsePose(file, &rest);
    rig.others.push_back(other);
  }
  return rig;
}

ModelFrame ParseFrame(const TextFile& file) {
  std::string_view rest = file.Line();
  ModelFrame frame;
  frame.frame_id = file.ParseNumber<uint32_t>(NextWord(&rest));
  frame.rig_id = file.ParseNumber<uint32_t>(NextWord(&rest));
  frame.rig_from_world = ParsePose(file, &rest);
  const uint32_t num_data = file.ParseNumber<uint32_t>(NextWord(&rest));
  for (uint32_t i = 0; i < num_data; ++i) {
    const Sensor sensor = ParseSensor(file, &rest);
    frame.data.push_back({sensor, file.ParseNumber<uint64_t>(NextWord(&rest))});
  }
  return frame;
}

ModelImage ParseImage(const TextFile& file) {
  std::string_view rest = file.Line();
  ModelImage image;
  image.image_id = file.ParseNumber<uint32_t>(NextWord(&rest));
  image.cam_from_world = ParsePose(file, &rest);
  image.camera_id = file.ParseNumber<uint32_t>(NextWord(&rest));
  image.name = Trimmed(rest);  // the rest of the line, because a name may hold spaces
  return image;
}

// True if the line can be an image's points, `X Y POINT3D_ID` each.
bool IsPointsLine(std::string_view line) {
  size_t num_words = 0;
  std::string_view last_word;
  for (std::string_view word = NextWord(&line); !word.empty(); word = NextWord(&line)) {
    last_word = word;
    ++num_words;
  }
  return num_words % 3 == 0 && last_word.find_first_not_of("-0123456789") == std::string_view::npos;
}

template <typename Record>
void ReadEntries(const std::filesystem::path& path, Record (*parse)(const TextFile&), ModelBuilder* builder) {
  TextFile file(path);
  while (file.NextEntry()) {
    if (const std::string problem = builder->Add(parse(file)); !problem.empty()) throw file.Error(problem);
    // Checks the second line of each image, which has its points or is empty, because a file without these lines would
    // silently lose every other image.
    if (std::is_same_v<Record, ModelImage> && file.NextLine() && !IsPointsLine(file.Line())) {
      throw file.Error("expected the points of the image above (X Y POINT3D_ID ..., or an empty line)");
    }
  }
}

}  // namespace

void ReadTextModel(const std::filesystem::path& folder, ModelBuilder* builder) {
  ReadEntries(folder / "cameras.txt", ParseCameraLine, builder);
  if (IsTaken(folder / "rigs.txt")) ReadEntries(folder / "rigs.txt", ParseRig, builder);
  if (IsTaken(folder / "frames.txt")) ReadEntries(folder / "frames.txt", ParseFrame, builder);
  ReadEntries(folder / "images.txt", ParseImage, builder);
}

Camera ParseCamera(int model_id, std::string_view rest, const TextFile& file) {
  Camera camera;
  camera.model_id = model_id;
  camera.width = file.ParseNumber<uint64_t>(NextWord(&rest));
  camera.height = file.ParseNumber<uint64_t>(NextWord(&rest));
  for (std::string_view word = NextWord(&rest); !word.empty(); word = NextWord(&rest)) {
    camera.params.push_back(file.ParseNumber<double>(word));
  }
  return camera;
}

}  // namespace lazyloc

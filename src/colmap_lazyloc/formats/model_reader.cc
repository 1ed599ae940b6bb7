#include "colmap_lazyloc/formats/model_reader.h"

#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <type_traits>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/files/binary_file.h"
#include "colmap_lazyloc/files/paths.h"
#include "colmap_lazyloc/files/text_file.h"
#include "colmap_lazyloc/formats/geo_file.h"
#include "colmap_lazyloc/formats/model_builder.h"

namespace lazyloc {
namespace {

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

// Reads the parts of a model from one of its files, number by number.
template <typename File>
class PartReader {
 public:
  explicit PartReader(const std::filesystem::path& path) : file_(path) {
    if constexpr (!kIsText) num_left_ = file_.ReadCount();
  }

  template <typename Part>
  void ReadAll(ModelBuilder* builder) {
    while (Next()) {
      Part part;
      Read(&part);
      if constexpr (std::is_same_v<Part, ModelImage>) image_id_ = part.image_id;
      if (const std::string problem = builder->Add(std::move(part)); !problem.empty()) throw file_.Error(problem);
      if constexpr (std::is_same_v<Part, ModelImage>) points_.emplace(image_id_, SkipPoints());
    }
  }

  PointsPlaces TakePoints() { return std::move(points_); }

 private:
  static constexpr bool kIsText = std::is_same_v<File, TextFile>;

  // Goes to the next part. Returns false at the end of the file.
  bool Next() {
    if constexpr (kIsText) {
      const bool has_entry = file_.NextEntry();
      rest_ = file_.Line();
      return has_entry;
    } else {
      if (num_left_ == 0) file_.CheckEnd();
      return num_left_-- > 0;
    }
  }
  PointsPlace SkipPoints() {
    if constexpr (kIsText) {
      // Checks the second line of each image, which has its points or is empty, because a file without these lines
      // would silently lose every other image.
      if (!file_.NextLine()) return {file_.LineOffset(), 0};
      if (IsPointsLine(file_.Line())) return {file_.LineOffset(), file_.LineSize()};
      throw file_.Error("expected the points of the image above (X Y POINT3D_ID ..., or an empty line)");
    } else {
      const uint64_t num_bytes = file_.ReadCount() * (2 * sizeof(double) + sizeof(uint64_t));
      const PointsPlace place = {file_.Offset(), num_bytes};
      file_.Skip(num_bytes);
      return place;
    }
  }
  template <typename Number>
  void Read(Number* number) {
    if constexpr (kIsText) {
      *number = file_.template ParseNumber<Number>(NextWord(&rest_));
    } else {
      *number = file_.template Read<Number>();
    }
  }
  void Read(bool* flag) {
    std::conditional_t<kIsText, int, uint8_t> number;
    Read(&number);
    *flag = number != 0;
  }
  void Read(SensorType* type) {
    if constexpr (kIsText) {
      const std::string word(NextWord(&rest_));
      if (word != "CAMERA" && word != "IMU") throw file_.Error("unknown sensor type '" + word + "'");
      *type = word == "CAMERA" ? SensorType::CAMERA : SensorType::IMU;
    } else {
      const auto number = file_.template Read<int32_t>();
      *type = static_cast<SensorType>(number);
      if (*type == SensorType::CAMERA || *type == SensorType::IMU) return;
      throw file_.Error("unknown sensor type " + std::to_string(number));
    }
  }
  void Read(Camera* camera) {
    uint32_t camera_id = 0;
    Read(&camera_id);
    if constexpr (kIsText) {
      const std::string model_name(NextWord(&rest_));
      const std::optional<int> model_id = CameraModelId(model_name);
      if (!model_id) throw file_.Error("unknown camera model '" + model_name + "'");
      *camera = ParseCamera(*model_id, rest_, file_);
    } else {
      Read(&camera->model_id);
      Read(&camera->width);
      Read(&camera->height);
      camera->params.resize(CameraModelNumParams(camera->model_id));  // the format does not store their number
      for (double& param : camera->params) Read(&param);
    }
    camera->camera_id = camera_id;
  }
  void Read(Rigid3d* pose) {
    for (double* number : {&pose->rotation.w(), &pose->rotation.x(), &pose->rotation.y(), &pose->rotation.z(),
                           &pose->translation.x(), &pose->translation.y(), &pose->translation.z()}) {
      Read(number);
    }
  }
  void Read(Sensor* sensor) {
    Read(&sensor->type);
    Read(&sensor->sensor_id);
  }
  void Read(Rig* rig) {
    uint32_t num_sensors = 0;
    Read(&rig->rig_id);
    Read(&num_sensors);
    if (num_sensors > 0) Read(&rig->reference.emplace());
    for (uint32_t i = 1; i < num_sensors; ++i) {
      RigSensor& other = rig->others.emplace_back();
      bool has_pose = false;
      Read(&other.sensor);
      Read(&has_pose);
      if (has_pose) Read(&other.sensor_from_rig.emplace());
    }
  }
  void Read(ModelFrame* frame) {
    uint32_t num_data = 0;
    Read(&frame->frame_id);
    Read(&frame->rig_id);
    Read(&frame->rig_from_world);
    Read(&num_data);
    for (uint32_t i = 0; i < num_data; ++i) {
      FrameData& data = frame->data.emplace_back();
      Read(&data.sensor);
      Read(&data.data_id);
    }
  }
  void Read(ModelImage* image) {
    Read(&image->image_id);
    Read(&image->cam_from_world);
    Read(&image->camera_id);
    if constexpr (kIsText) {
      image->name = Trimmed(rest_);  // the rest of the line, because a name may hold spaces
    } else {
      image->name = file_.ReadName();
    }
  }

  File file_;
  uint32_t image_id_ = 0;  // of the current image
  PointsPlaces points_;
  std::string_view rest_;  // of a line of text
  uint64_t num_left_ = 0;  // parts of a binary file
};

template <typename File>
ModelOnDisk ReadFiles(const std::filesystem::path& folder, const std::string& ending) {
  const auto path = [&](const std::string& name) { return folder / (name + ending); };
  ModelBuilder builder;
  PartReader<File>(path("cameras")).template ReadAll<Camera>(&builder);
  if (IsTaken(path("rigs"))) PartReader<File>(path("rigs")).template ReadAll<Rig>(&builder);
  if (IsTaken(path("frames"))) PartReader<File>(path("frames")).template ReadAll<ModelFrame>(&builder);
  PartReader<File> images(path("images"));
  images.template ReadAll<ModelImage>(&builder);
  return {builder.Take(), path("images"), images.TakePoints()};
}

// Returns the file name ending of the model in a folder; nothing if there is none.
std::optional<std::string> FindEnding(const std::filesystem::path& folder) {
  for (const std::string ending : {".bin", ".txt"}) {
    if (IsTaken(folder / ("cameras" + ending)) && IsTaken(folder / ("images" + ending))) return ending;
  }
  return std::nullopt;
}

// Returns what an error about a folder without a model ends with: the model in a folder inside, such as sparse/0.
std::string ModelInside(const std::filesystem::path& folder) {
  std::error_code error;
  std::set<std::filesystem::path> models;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    if (FindEnding(entry.path())) models.insert(entry.path());
  }
  return models.empty() ? "" : "; give " + models.begin()->string();
}

}  // namespace

Model ReadModel(const std::filesystem::path& path) {
  ModelOnDisk read = ReadModelWithPoints(path);
  if (read.model.images.empty()) throw InputError(read.images_path.string() + ": contains no posed image");
  read.model.axes = ReadAxes(path);
  return std::move(read.model);
}

ModelOnDisk ReadModelWithPoints(const std::filesystem::path& path) {
  const std::optional<std::string> ending = FindEnding(path);
  if (!ending) {
    throw InputError(path.string() +
                     ": holds no COLMAP model: neither cameras.bin and images.bin nor cameras.txt and images.txt" +
                     ModelInside(path));
  }
  return *ending == ".bin" ? ReadFiles<BinaryFile>(path, ".bin") : ReadFiles<TextFile>(path, ".txt");
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

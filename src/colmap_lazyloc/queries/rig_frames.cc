#include "colmap_lazyloc/queries/rig_frames.h"

#include <unordered_set>

#include "colmap_lazyloc/formats/rig_config.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

bool StartsWith(std::string_view text, std::string_view prefix) { return text.compare(0, prefix.size(), prefix) == 0; }

// Returns the folder that the image prefixes of a rig's cameras have in common.
std::string CommonFolder(const RigCameras& cameras) {
  std::string folder = cameras.front().image_prefix;
  for (const RigCamera& camera : cameras) {
    while (!StartsWith(camera.image_prefix, folder)) folder.pop_back();
  }
  return folder.substr(0, folder.rfind('/') + 1);
}

// Returns what the names of each rig's frames begin with: the rig's folder, and its number if folders do not tell the
// rigs apart.
std::vector<std::string> FrameLabels(const std::vector<RigCameras>& rigs) {
  std::vector<std::string> labels;
  for (const RigCameras& rig : rigs) labels.push_back(CommonFolder(rig));
  bool are_distinct = true;
  for (size_t i = 0; i < rigs.size(); ++i) {
    for (size_t j = 0; j < rigs.size(); ++j)
      are_distinct = are_distinct && (i == j || !StartsWith(labels[i], labels[j]));
  }
  for (size_t i = 0; i < rigs.size() && !are_distinct; ++i)
    labels[i] = "rig " + std::to_string(i + 1) + ": " + labels[i];
  return labels;
}

// Returns the names of the images that are among these, by id.
template <typename Image>
std::unordered_map<uint64_t, std::string> NamesById(const std::vector<Image>& images,
                                                    const std::vector<std::string_view>& image_names) {
  const std::unordered_set<std::string_view> wanted(image_names.begin(), image_names.end());
  std::unordered_map<uint64_t, std::string> name_of_id;
  for (const Image& image : images) {
    if (wanted.count(image.name) > 0) name_of_id.emplace(image.image_id, image.name);
  }
  return name_of_id;
}

FramePlaces FramesFromDatabase(const std::vector<std::string_view>& image_names, const DatabaseReader& database,
                               FrameProblems* problems) {
  const std::vector<DatabaseRigImage> rig_images = database.ReadRigImages(&problems->damages);
  if (rig_images.empty()) return {};
  const auto name_of_id = NamesById(database.ReadImages(), image_names);
  FramePlaces places;
  for (const DatabaseRigImage& image : rig_images) {
    const auto name = name_of_id.find(image.image_id);
    if (name == name_of_id.end()) continue;
    if (image.cam_from_rig) {
      places[name->second] = {std::to_string(image.frame_id), *image.cam_from_rig};
    } else {
      problems->images_without_pose.push_back(name->second);
    }
  }
  return places;
}

FramePlaces FramesFromModel(const std::vector<std::string_view>& image_names, const Model& model) {
  if (model.frames.empty()) return {};
  const auto name_of_id = NamesById(model.images, image_names);
  FramePlaces places;
  for (const auto& [frame_id, frame] : model.frames) {
    const Rig& rig = model.rigs.at(frame.rig_id);
    FramePlaces frame_places;
    for (const FrameData& data : frame.data) {
      const auto name = name_of_id.find(data.data_id);
      if (data.sensor.type != SensorType::CAMERA || name == name_of_id.end()) continue;
      const std::optional<Rigid3d> cam_from_rig = SensorFromRig(rig, data.sensor);
      if (!cam_from_rig) continue;
      frame_places[name->second] = {"model's " + std::to_string(frame_id),
                                    {cam_from_rig->rotation.normalized(), cam_from_rig->translation}};
    }
    if (frame_places.size() > 1) places.merge(frame_places);
  }
  return places;
}

}  // namespace

FramePlaces FramesFromConfig(const std::vector<std::string_view>& image_names,
                             const std::filesystem::path& rig_config_path) {
  const std::vector<RigCameras> rigs = ReadRigConfig(rig_config_path);
  const std::vector<std::string> labels = FrameLabels(rigs);
  FramePlaces places;
  for (const std::string_view name : image_names) {
    for (size_t rig = 0; rig < rigs.size(); ++rig) {
      for (const RigCamera& camera : rigs[rig]) {
        if (!StartsWith(name, camera.image_prefix)) continue;
        const std::string frame = labels[rig] + std::string(name.substr(camera.image_prefix.size()));
        if (!places.emplace(name, FramePlace{frame, camera.cam_from_rig}).second) {
          throw InputError(rig_config_path.string() + ": image " + std::string(name) +
                           " matches the image_prefix of two cameras");
        }
      }
    }
  }
  return places;
}

FramePlaces FramesFromColmap(const std::vector<std::string_view>& image_names, const DatabaseReader* database,
                             const Model& model, FrameProblems* problems) {
  FramePlaces places = FramesFromModel(image_names, model);
  if (database != nullptr) places.merge(FramesFromDatabase(image_names, *database, problems));
  return places;
}

FramePlaces SharedFrames(const FramePlaces& places) {
  std::unordered_map<std::string, int> num_images;
  for (const auto& [name, place] : places) ++num_images[place.frame_name];
  FramePlaces shared;
  for (const auto& [name, place] : places) {
    if (num_images[place.frame_name] > 1) shared.emplace(name, place);
  }
  return shared;
}

}  // namespace lazyloc

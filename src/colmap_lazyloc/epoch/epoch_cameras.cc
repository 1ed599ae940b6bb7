#include "colmap_lazyloc/epoch/epoch_cameras.h"

#include <algorithm>
#include <map>
#include <string>
#include <tuple>

#include "colmap_lazyloc/math/robust_statistics.h"

namespace lazyloc {
namespace {

// What photos of one camera have in common.
using CameraKey = std::tuple<int, uint64_t, uint64_t, std::vector<double>, std::string>;

const Camera* FindModelCamera(const Model& model, const Camera& camera) {
  for (const auto& id_and_camera : model.cameras) {
    if (SameIntrinsics(id_and_camera.second, camera)) return &id_and_camera.second;
  }
  return nullptr;
}

// Returns the median of each parameter, of the cameras with the most frequent model.
Camera MedianCamera(const std::vector<Camera>& cameras) {
  std::map<int, int> counts;
  for (const Camera& camera : cameras) ++counts[camera.model_id];
  const auto most =
      std::max_element(counts.begin(), counts.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  std::vector<std::vector<double>> values;
  Camera median;
  for (const Camera& camera : cameras) {
    if (camera.model_id != most->first) continue;
    if (values.empty()) median = camera;
    values.resize(camera.params.size());
    for (size_t i = 0; i < values.size(); ++i) values[i].push_back(camera.params[i]);
  }
  for (size_t i = 0; i < values.size(); ++i) median.params[i] = Median(values[i]);
  return median;
}

}  // namespace

std::vector<EpochCamera> ChooseCameras(const Model& model, const DatabaseReader& database, bool shares,
                                       std::vector<EpochPhoto>* photos) {
  std::map<CameraKey, int> camera_of_key;
  std::vector<EpochCamera> cameras;
  std::vector<std::vector<Camera>> localized;  // by camera
  const std::vector<DatabaseImage> images = database.ReadImages();
  for (EpochPhoto& photo : *photos) {
    if (!photo.database_id) continue;
    const Camera stored = database.ReadCamera(FindByName(images, photo.Name())->camera_id);
    const Camera* of_model = photo.is_placed ? FindModelCamera(model, photo.record.result.query_camera) : nullptr;
    const Camera& common = of_model == nullptr ? stored : *of_model;
    const CameraKey key(common.model_id, common.width, common.height, common.params,
                        of_model != nullptr ? "model"
                        : shares            ? ""
                                            : photo.Name());
    const auto [entry, is_new] = camera_of_key.emplace(key, static_cast<int>(cameras.size()));
    if (is_new) {
      cameras.push_back({common, of_model != nullptr, 0});
      localized.emplace_back();
    }
    photo.camera = entry->second;
    if (!photo.is_placed) continue;
    ++cameras[photo.camera].num_photos;
    localized[photo.camera].push_back(photo.record.result.query_camera);
  }
  for (size_t i = 0; i < cameras.size(); ++i) {
    if (!cameras[i].is_constant && !localized[i].empty()) cameras[i].camera = MedianCamera(localized[i]);
  }
  return cameras;
}

}  // namespace lazyloc

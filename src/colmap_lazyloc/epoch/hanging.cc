#include "colmap_lazyloc/epoch/hanging.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/files/output_file.h"
#include "colmap_lazyloc/localizer/localizer.h"
#include "colmap_lazyloc/scene/free_ids.h"

namespace lazyloc {
namespace {

constexpr int kMaxNumHangingsOfPhoto = 2;  // it gets a second chance when the photos that it hangs on are adjusted

using PhotosByName = std::map<std::string, EpochPhoto*>;

// Returns a model of the database images and the photos that have a pose. It has no rigs, because photos are in none.
Model WithPhotos(Model model, const std::vector<EpochCamera>& cameras, const std::vector<EpochPhoto>& photos) {
  model.rigs.clear();
  model.frames.clear();
  FreeIds image_ids, camera_ids(model.cameras);
  for (const ModelImage& image : model.images) image_ids.Use(image.image_id);
  std::vector<uint32_t> ids;
  for (const EpochCamera& camera : cameras) {
    ids.push_back(camera_ids.Next());
    Camera added = camera.camera;
    added.camera_id = ids.back();
    model.cameras.emplace(ids.back(), std::move(added));
  }
  for (const EpochPhoto& photo : photos) {
    if (photo.is_placed) model.images.push_back({image_ids.Next(), ids[photo.camera], photo.Name(), photo.Pose()});
  }
  std::sort(model.images.begin(), model.images.end(),
            [](const ModelImage& a, const ModelImage& b) { return a.name < b.name; });
  return model;
}

// Writes the photos, with their camera if others have determined it.
void WriteQueryList(const std::vector<EpochCamera>& cameras, const PhotosByName& rest,
                    const std::filesystem::path& path) {
  OutputFile file(path);
  for (const auto& [name, photo] : rest) {
    file.Text() << name;
    const EpochCamera& epoch_camera = cameras[photo->camera];
    const Camera& camera = epoch_camera.camera;
    if (epoch_camera.num_photos > 0 && name.find(' ') == std::string::npos) {
      file.Text() << ' ' << CameraModelName(camera.model_id) << ' ' << camera.width << ' ' << camera.height;
      for (const double param : camera.params) file.Text() << ' ' << param;
    }
    file.Text() << '\n';
  }
  file.Close();
}

// Returns the probability that the images that a photo hangs on are where they should be: the mean of theirs, by the
// number of matches.
double ConfidenceInOthers(const LocalizationResult& result, const std::map<std::string, double>& confidences) {
  double sum = 0, weight = 0;
  for (const PairResult& pair : result.pairs) {
    const auto photo = confidences.find(pair.database_name);
    sum += pair.num_inliers * (photo == confidences.end() ? 1 : photo->second);
    weight += pair.num_inliers;
  }
  return weight == 0 ? 0 : sum / weight;
}

}  // namespace

int HangPhotos(const Model& model, const std::vector<EpochCamera>& cameras, const HangingOptions& options,
               std::vector<EpochPhoto>* photos) {
  PhotosByName rest;
  std::map<std::string, double> confidences;  // of those with a pose
  for (EpochPhoto& photo : *photos) {
    if (photo.is_placed) {
      confidences.emplace(photo.Name(), photo.record.result.confidence.value_or(0));
    } else if (photo.database_id && photo.num_hangings < kMaxNumHangingsOfPhoto) {
      rest.emplace(photo.Name(), &photo);
    }
  }
  if (rest.empty() || confidences.empty()) return 0;
  WriteQueryList(cameras, rest, options.query_list);
  SourceOptions source;
  source.database_path = options.database_path;
  source.selection.query_list_path = options.query_list.string();
  source.selection.groups.use_rigs = false;
  LocalizerOptions method;
  method.min_confidence = options.min_confidence;
  IdleThreads idle_threads(EffectiveNumThreads(options.num_threads) - 1);
  const Localizer localizer(source, method, WithPhotos(model, cameras, *photos), options.num_threads, &idle_threads);
  std::vector<std::vector<QueryRecord>> records(localizer.Source()->NumGroups());
  ParallelFor(
      records.size(), [&](size_t i) { records[i] = localizer.Localize(localizer.Source()->Group(i)); }, &idle_threads);
  int num_found = 0;
  for (std::vector<QueryRecord>& group : records) {
    for (QueryRecord& record : group) {
      LocalizationResult& result = record.result;
      if (result.status != QueryStatus::LOCALIZED) continue;
      result.confidence = result.confidence.value_or(0) * ConfidenceInOthers(result, confidences);
      if (*result.confidence < options.min_confidence) continue;
      EpochPhoto& photo = *rest.at(result.query_name);
      record.epoch = EpochResult();
      record.epoch->hangs_on_others = true;
      photo.localized = MakePoseDistribution(result.cam_from_world, result.covariance);
      photo.refused = std::exchange(photo.record, std::move(record));
      photo.is_placed = true;
      ++photo.num_hangings;
      ++num_found;
    }
  }
  return num_found;
}

}  // namespace lazyloc

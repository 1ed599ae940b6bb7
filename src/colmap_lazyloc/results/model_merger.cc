#include "colmap_lazyloc/results/model_merger.h"

#include <algorithm>
#include <optional>
#include <string>
#include <tuple>
#include <unordered_map>
#include <unordered_set>

#include "colmap_lazyloc/scene/free_ids.h"

namespace lazyloc {
namespace {

// What is equal for cameras with the same intrinsics.
using Intrinsics = std::tuple<int, uint64_t, uint64_t, std::vector<double>>;

Intrinsics IntrinsicsOf(const Camera& camera) { return {camera.model_id, camera.width, camera.height, camera.params}; }

// The cameras of the merged model, to which those of queries are added.
class CameraMerger {
 public:
  // database_images: whose cameras are shared by several images.
  CameraMerger(const QueryRecords& records, const std::vector<DatabaseImage>& database_images,
               std::map<uint32_t, Camera>* cameras)
      : cameras_(*cameras), new_ids_(*cameras) {
    for (const auto& [camera_id, camera] : cameras_) by_intrinsics_.emplace(IntrinsicsOf(camera), camera_id);
    for (const DatabaseImage& image : database_images) ++num_images_[image.camera_id];
    records.ForEach([this](const QueryRecord& record) { new_ids_.Use(record.result.query_camera.camera_id); });
  }

  // Returns the id of a query's camera.
  uint32_t Add(const LocalizationResult& query) {
    Camera camera = query.query_camera;
    // Takes the id away if the camera was refined for this query alone but other images of the database share it.
    const auto num_images = num_images_.find(camera.camera_id);
    if (query.is_camera_refined && num_images != num_images_.end() && num_images->second > 1) camera.camera_id = 0;

    const auto own = cameras_.find(camera.camera_id);
    if (own != cameras_.end() && SameIntrinsics(own->second, camera)) return own->first;
    const auto same = by_intrinsics_.find(IntrinsicsOf(camera));
    if (same != by_intrinsics_.end()) return same->second;
    const bool own_id_is_free = own == cameras_.end() && camera.camera_id != 0;  // 0: a camera without id
    if (!own_id_is_free) camera.camera_id = new_ids_.Next();
    cameras_.emplace(camera.camera_id, camera);
    by_intrinsics_.emplace(IntrinsicsOf(camera), camera.camera_id);
    return camera.camera_id;
  }

 private:
  std::map<uint32_t, Camera>& cameras_;
  FreeIds new_ids_;
  std::unordered_map<uint32_t, size_t> num_images_;  // of the database, by camera
  std::map<Intrinsics, uint32_t> by_intrinsics_;     // the smallest id of a camera
};

// Returns the id that a query gets if it is free.
std::optional<uint32_t> PreferredImageId(const std::string& name, const Model& model,
                                         const std::vector<DatabaseImage>& database_images) {
  if (const ModelImage* image = FindByName(model.images, name)) return image->image_id;
  if (const DatabaseImage* image = FindByName(database_images, name)) return image->image_id;
  return std::nullopt;
}

// Adds the localized queries' images and cameras. merged: has the images that are not queries.
void AddQueryImages(const Model& model, const QueryRecords& records, const std::vector<DatabaseImage>& database_images,
                    MergedModel* merged) {
  FreeIds new_image_ids;
  for (const ModelImage& image : model.images) new_image_ids.Use(image.image_id);
  for (const DatabaseImage& image : database_images) new_image_ids.Use(image.image_id);
  std::unordered_set<uint32_t> taken_ids;
  for (const MergedImage& image : merged->images) taken_ids.insert(image.image_id);
  CameraMerger cameras(records, database_images, &merged->cameras);
  merged->image_of_query.reserve(records.Size());
  records.ForEach([&](const QueryRecord& record) {
    const LocalizationResult& query = record.result;
    const auto index = static_cast<uint32_t>(merged->image_of_query.size());
    merged->image_of_query.push_back(MergedModel::kNoImage);
    if (query.status != QueryStatus::LOCALIZED) return;
    const auto preferred_id = PreferredImageId(query.query_name, model, database_images);
    const bool is_free = preferred_id && taken_ids.insert(*preferred_id).second;
    const uint32_t image_id = is_free ? *preferred_id : new_image_ids.Next();
    const uint32_t camera_id = cameras.Add(query);
    merged->images.push_back({image_id, camera_id, index, true});
    merged->image_of_query.back() = image_id;
    if (!merged->rigs.empty()) {
      AddFrameOfOneImage({image_id, camera_id, query.query_name, query.cam_from_world}, merged);
    }
  });
}

}  // namespace

MergedModel MergeModel(const Model& model, const QueryRecords& records,
                       const std::vector<DatabaseImage>& database_images) {
  MergedModel merged;
  merged.cameras = model.cameras;
  merged.images.reserve(model.images.size() + records.Size());
  for (uint32_t i = 0; i < model.images.size(); ++i) {
    const ModelImage& image = model.images[i];
    if (!records.Find(image.name)) merged.images.push_back({image.image_id, image.camera_id, i, false});
  }
  std::sort(merged.images.begin(), merged.images.end());
  KeepRigs(model, &merged);
  AddQueryImages(model, records, database_images, &merged);
  std::sort(merged.images.begin(), merged.images.end());
  return merged;
}

}  // namespace lazyloc

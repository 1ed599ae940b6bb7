#include "colmap_lazyloc/results/model_merger.h"

#include <algorithm>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>

#include "colmap_lazyloc/results/rig_merger.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/free_ids.h"

namespace lazyloc {
namespace {

// Returns equal values for equal intrinsics.
size_t HashOfIntrinsics(const Camera& camera) {
  size_t hash = std::hash<uint64_t>()(camera.width * 65536 + camera.height) + static_cast<size_t>(camera.model_id);
  for (const double param : camera.params) hash = hash * 31 + std::hash<double>()(param);
  return hash;
}

// The cameras of the merged model, to which those of queries are added.
class CameraMerger {
 public:
  // database_images: whose cameras are shared by several images.
  CameraMerger(const QueryRecords& records, const std::vector<DatabaseImage>& database_images,
               std::map<uint32_t, Camera>* cameras)
      : cameras_(*cameras), new_ids_(*cameras) {
    for (const auto& [camera_id, camera] : cameras_) by_intrinsics_.emplace(HashOfIntrinsics(camera), camera_id);
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
    const size_t hash = HashOfIntrinsics(camera);
    for (auto same = by_intrinsics_.lower_bound({hash, 0}); same != by_intrinsics_.end() && same->first == hash;
         ++same) {
      if (SameIntrinsics(cameras_.at(same->second), camera)) return same->second;
    }
    const bool own_id_is_free = own == cameras_.end() && camera.camera_id != 0;  // 0: a camera without id
    if (!own_id_is_free) camera.camera_id = new_ids_.Next();
    cameras_.emplace(camera.camera_id, camera);
    by_intrinsics_.emplace(hash, camera.camera_id);
    return camera.camera_id;
  }

 private:
  std::map<uint32_t, Camera>& cameras_;
  FreeIds new_ids_;
  std::unordered_map<uint32_t, size_t> num_images_;      // of the database, by camera
  std::set<std::pair<size_t, uint32_t>> by_intrinsics_;  // hash, camera id
};

// Tells which ids of a list are taken.
class TakenIds {
 public:
  explicit TakenIds(std::vector<uint32_t> ids) : ids_(std::move(ids)) {
    std::sort(ids_.begin(), ids_.end());
    is_taken_.resize(ids_.size());
  }
  // Takes an id of the list. Returns false if it was taken before.
  bool Take(uint32_t id) {
    const auto place = static_cast<size_t>(std::lower_bound(ids_.begin(), ids_.end(), id) - ids_.begin());
    if (is_taken_[place]) return false;
    return is_taken_[place] = true;
  }

 private:
  std::vector<uint32_t> ids_;
  std::vector<bool> is_taken_;
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
  std::vector<uint32_t> ids;
  for (const ModelImage& image : model.images) ids.push_back(image.image_id);
  for (const DatabaseImage& image : database_images) ids.push_back(image.image_id);
  for (const uint32_t id : ids) new_image_ids.Use(id);
  TakenIds taken_ids(std::move(ids));
  for (const MergedImage& image : merged->images) taken_ids.Take(image.image_id);
  CameraMerger cameras(records, database_images, &merged->cameras);
  merged->image_of_query.reserve(records.Size());
  records.ForEach([&](const QueryRecord& record) {
    const LocalizationResult& query = record.result;
    const auto index = static_cast<uint32_t>(merged->image_of_query.size());
    merged->image_of_query.push_back(MergedModel::kNoImage);
    if (query.status != QueryStatus::LOCALIZED) return;
    const auto preferred_id = PreferredImageId(query.query_name, model, database_images);
    const bool is_free = preferred_id && taken_ids.Take(*preferred_id);
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

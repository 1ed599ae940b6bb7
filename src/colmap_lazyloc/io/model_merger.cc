#include "colmap_lazyloc/io/model_merger.h"

#include <algorithm>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "colmap_lazyloc/io/free_ids.h"
#include "colmap_lazyloc/io/rig_merger.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

using IdOfName = std::unordered_map<std::string, uint32_t>;
using ImageOfName = std::unordered_map<std::string, MergedImage*>;

uint32_t AddQueryCamera(const Camera& camera, std::map<uint32_t, Camera>* cameras, FreeIds* new_ids) {
  const auto own = cameras->find(camera.camera_id);
  if (own != cameras->end() && SameIntrinsics(own->second, camera)) return own->first;
  const auto same = std::find_if(cameras->begin(), cameras->end(),
                                 [&](const auto& other) { return SameIntrinsics(other.second, camera); });
  if (same != cameras->end()) return same->first;

  const bool own_id_is_free = own == cameras->end() && camera.camera_id != 0;  // 0: a camera without id
  Camera added = camera;
  added.camera_id = own_id_is_free ? camera.camera_id : new_ids->Next();
  cameras->emplace(added.camera_id, added);
  return added.camera_id;
}

// Returns the id that a query gets if it is free.
std::optional<uint32_t> PreferredImageId(const std::string& name, const IdOfName& model_ids,
                                         const IdOfName& database_ids) {
  for (const IdOfName* ids : {&model_ids, &database_ids}) {
    const auto id = ids->find(name);
    if (id != ids->end()) return id->second;
  }
  return std::nullopt;
}

// Returns a query's camera. It has no id if it was refined for this query alone but other images of the database share
// it.
Camera CameraOf(const LocalizationResult& query, const std::vector<DatabaseImage>& database_images) {
  Camera camera = query.query_camera;
  const auto has_camera = [&](const DatabaseImage& image) { return image.camera_id == camera.camera_id; };
  if (query.is_camera_refined && std::count_if(database_images.begin(), database_images.end(), has_camera) > 1) {
    camera.camera_id = 0;
  }
  return camera;
}

// Adds the localized queries' images and cameras.
void AddQueryImages(const std::vector<const QueryRecord*>& records, const std::vector<DatabaseImage>& database_images,
                    const IdOfName& model_ids, const IdOfName& database_ids, MergedModel* merged) {
  FreeIds new_image_ids, new_camera_ids(merged->cameras);
  for (const auto& [name, image_id] : model_ids) new_image_ids.Use(image_id);
  for (const auto& [name, image_id] : database_ids) new_image_ids.Use(image_id);
  for (const QueryRecord* record : records) new_camera_ids.Use(record->result.query_camera.camera_id);

  for (const QueryRecord* record : records) {
    const LocalizationResult& query = record->result;
    if (query.status != QueryStatus::LOCALIZED) continue;
    const auto preferred_id = PreferredImageId(query.query_name, model_ids, database_ids);
    const bool is_free = preferred_id && merged->images.count(*preferred_id) == 0;
    MergedImage added;
    added.image.image_id = is_free ? *preferred_id : new_image_ids.Next();
    added.image.camera_id = AddQueryCamera(CameraOf(query, database_images), &merged->cameras, &new_camera_ids);
    added.image.name = query.query_name;
    added.image.cam_from_world = query.cam_from_world;
    added.photo_keypoints = record->keypoints;
    if (added.photo_keypoints.empty()) added.database_id = database_ids.at(query.query_name);
    if (!merged->rigs.empty()) AddFrameOfOneImage(added.image, merged);
    merged->images.emplace(added.image.image_id, std::move(added));
  }
}

// pair_images: the images of the query's pairs, null for an image that is not in the merged model.
void AddPoint(const PointResult& point, MergedImage* query_image, const std::vector<MergedImage*>& pair_images,
              MergedModel* merged) {
  const uint64_t point_id = merged->points.size() + 1;
  // Keeps the error of the whole track, even if an observation goes to another point.
  MergedPoint added{point.point_in_world, point.mean_reprojection_error_px, {}};
  const auto observe = [&](MergedImage* image, int keypoint) {
    LAZYLOC_CHECK(keypoint >= 0);
    if (image->point_of_keypoint.emplace(keypoint, point_id).second) {
      added.track.push_back({image->image.image_id, static_cast<uint32_t>(keypoint)});
    }
  };
  observe(query_image, point.query_point);
  for (const auto& [pair_idx, keypoint] : point.observations) {
    MergedImage* image = pair_images.at(pair_idx);
    if (image != nullptr) observe(image, keypoint);
  }

  if (added.track.size() >= 2) {
    merged->points.push_back(std::move(added));
  } else {
    for (const TrackElement& element : added.track) {
      merged->images.at(element.image_id).point_of_keypoint.erase(element.keypoint);
    }
  }
}

void AddPoints(const LocalizationResult& query, const ImageOfName& images, MergedModel* merged) {
  std::vector<MergedImage*> pair_images;
  for (const PairResult& pair : query.pairs) {
    const auto image = images.find(pair.database_name);
    pair_images.push_back(image == images.end() ? nullptr : image->second);
  }
  for (const PointResult& point : query.points) AddPoint(point, images.at(query.query_name), pair_images, merged);
}

}  // namespace

MergedModel MergeModel(const Model& model, const std::vector<const QueryRecord*>& records,
                       const std::vector<DatabaseImage>& database_images) {
  std::unordered_set<std::string> query_names;
  for (const QueryRecord* record : records) query_names.insert(record->result.query_name);
  IdOfName model_ids, database_ids;
  for (const ModelImage& image : model.images) model_ids.emplace(image.name, image.image_id);
  for (const DatabaseImage& image : database_images) database_ids.emplace(image.name, image.image_id);

  MergedModel merged;
  merged.cameras = model.cameras;
  for (const ModelImage& image : model.images) {
    if (query_names.count(image.name) == 0) merged.images[image.image_id].image = image;
  }
  KeepRigs(model, &merged);
  AddQueryImages(records, database_images, model_ids, database_ids, &merged);

  ImageOfName images;
  for (auto& [image_id, image] : merged.images) images.emplace(image.image.name, &image);
  for (const QueryRecord* record : records) {
    if (record->result.status == QueryStatus::LOCALIZED) AddPoints(record->result, images, &merged);
  }
  for (auto& [image_id, image] : merged.images) {
    const bool is_photo = !image.photo_keypoints.empty();
    if (!image.point_of_keypoint.empty() && !is_photo) image.database_id = database_ids.at(image.image.name);
  }
  return merged;
}

}  // namespace lazyloc

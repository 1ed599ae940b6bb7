#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/runs/query_records.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// Image of the merged model: a database image, or a localized query.
struct MergedImage {
  uint32_t image_id = 0;
  uint32_t camera_id = 0;
  uint32_t index = 0;  // of the record or of the model's image
  bool is_query = false;

  bool operator<(const MergedImage& other) const { return image_id < other.image_id; }
};

// The images, cameras, rigs and frames of a model of the database images and the localized queries. Ids are the keys.
// A query takes only a few bytes, because there may be millions.
struct MergedModel {
  static constexpr uint32_t kNoImage = std::numeric_limits<uint32_t>::max();

  std::map<uint32_t, Camera> cameras;
  std::vector<MergedImage> images;       // by id
  std::vector<uint32_t> image_of_query;  // id by record; kNoImage if it was not localized
  // These are empty if the input model has no rigs.
  std::map<uint32_t, Rig> rigs;
  std::map<uint32_t, ModelFrame> frames;
  std::map<uint32_t, uint32_t> rig_of_camera;  // the first rig that has a pose for a camera
};

// Merges the localized queries into the model. The same input gives the same ids.
// - Images and cameras of the model keep ids and bits. An image that was a query appears with the pose that it was
//   localized at, or not at all.
// - A query's image id is the model's if it was there, else the database's if the model leaves it free, else a new one.
// - A query's camera is one of the model with the same intrinsics, if possible of the same id; else it is added under
//   its own id if that is free, or a new one. A camera that was refined for the query also gets a new id if other
//   images of the database share it.
// - Rigs and frames of the model stay, without images that are no longer in it; each query gets
//   a frame of its own.
// database_images: sorted by name.
MergedModel MergeModel(const Model& model, const QueryRecords& records,
                       const std::vector<DatabaseImage>& database_images);

// Copies the model's rigs and frames, bit for bit, but without images that are not in `merged` (sorted by id) and
// without frames that have no image left, because COLMAP 4 refuses frames whose images are missing.
void KeepRigs(const Model& model, MergedModel* merged);
// Gives an image a frame of its own in the rig of its camera, or in a new rig of this camera alone if no rig has a pose
// for it. The new ids are the image's and the camera's if these are free.
void AddFrameOfOneImage(const ModelImage& image, MergedModel* merged);

}  // namespace lazyloc

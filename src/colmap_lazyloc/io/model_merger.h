#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/io/query_record.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

struct TrackElement {
  uint32_t image_id = 0;
  uint32_t keypoint = 0;
};

struct MergedPoint {
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  double mean_reprojection_error_px = 0;
  std::vector<TrackElement> track;
};

struct MergedImage {
  ModelImage image;
  std::optional<uint32_t> database_id;             // of the image whose keypoints are needed; nullopt: none are
  std::vector<Eigen::Vector2d> photo_keypoints;    // of a photo, whose keypoints are not in the database
  std::map<uint32_t, uint64_t> point_of_keypoint;  // ids of the points that keypoints observe
};

// A COLMAP model of the database images and the localized queries. Ids are the keys; point ids are 1..n.
struct MergedModel {
  std::map<uint32_t, Camera> cameras;
  std::map<uint32_t, MergedImage> images;
  std::map<uint32_t, Rig> rigs;  // rigs and frames are empty if the input model has none
  std::map<uint32_t, ModelFrame> frames;
  std::vector<MergedPoint> points;  // the point with id i is points[i - 1]
};

// Merges the localized queries into the model. The same input gives the same ids.
// - Images and cameras of the model keep ids and bits. An image that was a query appears with the pose that it was
//   localized at, or not at all.
// - A query's image id is the model's if it was there, else the database's if the model leaves it free, else a new one.
// - A query's camera is one of the model with the same intrinsics, if possible of the same id; else it is added under
// its
//   own id if that is free, or a new one. A camera that was refined for the query also gets a new id if other images of
//   the database share it.
// - A keypoint observes at most one point. If the points of two queries meet in a keypoint, the first query keeps it
// and
//   the other's point loses this observation. A point with fewer than two observations is dropped.
// - Rigs and frames of the model stay, without images that are no longer in it (io/rig_merger.h); each query gets a
// frame
//   of its own.
// - Observations by images that are not in the merged model are left out.
// records: sorted by name.
MergedModel MergeModel(const Model& model, const std::vector<const QueryRecord*>& records,
                       const std::vector<DatabaseImage>& database_images);

}  // namespace lazyloc

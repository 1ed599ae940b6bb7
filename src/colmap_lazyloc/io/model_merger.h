#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/scene/localization_result.h"
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
  std::optional<uint32_t> database_id;             // where the image's keypoints are to be read; none: not needed
  std::vector<Eigen::Vector2d> photo_keypoints;    // those of a query that the database does not have
  std::map<uint32_t, uint64_t> point_of_keypoint;  // ids of the points, for the keypoints that observe one
};

// A COLMAP model of the database images and the localized queries. Ids are the keys; point ids are 1..n.
struct MergedModel {
  std::map<uint32_t, Camera> cameras;
  std::map<uint32_t, MergedImage> images;
  std::map<uint32_t, Rig> rigs;  // none where the input model has none, as with frames
  std::map<uint32_t, ModelFrame> frames;
  std::vector<MergedPoint> points;  // the point with id i is points[i - 1]
};

// Merges the localized queries into the model. The same input gives the same ids.
// - Images of the model keep ids and bits, its cameras too; but an image that was a query appears as such: with the
// pose
//   it was localized at, or not at all.
// - A query's image id is the model's if it was there, else the database's where the model leaves it free, else a new
// one
//   above all ids.
// - A query's camera is one of the model with the same intrinsics if there is one, its own id preferred; else
//   it is added under its own id where that is free, or a new one above all ids. A camera that was refined for the
//   query gets a new one too where other images of the database share it.
// - An image point can observe one point only. Where the points of two queries meet in a keypoint, the first query has
//   it and the other's point loses that observation. A point left with fewer than two is dropped.
// - Rigs and frames of the model stay, without the images that are no longer in it (io/rig_merger.h); each query gets
//   a frame of its own.
// - Observations by images that are not in the merged model are left out.
// results: sorted by name.
MergedModel MergeModel(const Model& model, const std::vector<const LocalizationResult*>& results,
                       const std::vector<DatabaseImage>& database_images);

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <tuple>

#include "colmap_lazyloc/files/external_sorter.h"
#include "colmap_lazyloc/results/model_merger.h"

namespace lazyloc {

// A keypoint that observes a point of the merged model.
struct PointObservation {
  uint32_t image_id = 0;
  uint32_t keypoint = 0;
  uint64_t point_id = 0;

  bool operator<(const PointObservation& other) const {
    return std::tie(image_id, keypoint) < std::tie(other.image_id, other.keypoint);
  }
};

// Writes the points of the localized queries as points3D.bin, query by query in the order of names, with ids 1..n, and
// adds their observations to the sorter.
// - A keypoint observes at most one point. If the points of two queries meet in a keypoint, the first query keeps it
//   and the other's point loses this observation. A point with fewer than two observations is dropped.
// - Observations by images that are not in the merged model are left out.
// - So are queries that were matched with other keypoints than those of the database images. was_matched: see
//   DatabaseContent.
// Memory: a bit for each observed keypoint of a database image, and the points of one query. Throws InputError naming
// the file if it cannot be written.
void WritePoints(const std::filesystem::path& path, const Model& model, const MergedModel& merged,
                 const QueryRecords& records, const std::function<bool(const QueryRecord&)>& was_matched,
                 ExternalSorter<PointObservation>* observations);

}  // namespace lazyloc

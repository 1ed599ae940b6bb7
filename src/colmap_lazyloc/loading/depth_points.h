#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/database/lru_cache.h"
#include "colmap_lazyloc/queries/query_selection.h"

namespace lazyloc {

// Points that database images triangulate among themselves, for comparison with depth maps. Each image is paired with
// the posed images that it shares most verified matches with. Damaged records are left out. Thread-safe with one reader
// per thread.
class DepthPoints {
 public:
  // The selection must outlive this.
  explicit DepthPoints(const QuerySelection& selection);

  // Returns the depths of these points at the keypoints of a database image, 0 where there is none. query_name: a query
  // and the images of its group take no part.
  std::vector<float> AtKeypoints(const std::string& image_name, const std::string& query_name,
                                 const DatabaseReader& database) const;

 private:
  std::vector<float> Triangulate(const ModelImage& image, uint32_t image_id, const std::string& query_name,
                                 const DatabaseReader& database) const;

  const QuerySelection& selection_;
  mutable LruCache<std::vector<float>> cache_;
};

}  // namespace lazyloc

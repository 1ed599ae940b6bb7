#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/database/lru_cache.h"
#include "colmap_lazyloc/queries/query_record.h"
#include "colmap_lazyloc/queries/query_selection.h"

namespace lazyloc {

// Returns the six posed images that a posed image shares most verified matches with, because more would tell little,
// and their ids in the database. A query and the images of its group take no part.
std::vector<std::pair<uint32_t, const ModelImage*>> FindNeighbours(const QuerySelection& selection, uint32_t image_id,
                                                                   const std::string& query_name,
                                                                   const DatabaseReader& database);

// Pairs of database images with each other, which tell how wrong database poses are. Only read for queries with less
// than three database images, because more tell it by themselves. Damaged records are left out. Thread-safe with one
// reader per thread.
class DatabaseNeighbours {
 public:
  // The selection must outlive this.
  explicit DatabaseNeighbours(const QuerySelection& selection);

  // Adds the pairs of the database images to query frames with few of these.
  void AddTo(const DatabaseReader& database, LoadedGroup* loaded) const;

 private:
  std::vector<NeighbourPair> Find(const ImagePair& pair, const std::string& query_name,
                                  const DatabaseReader& database) const;
  std::vector<NeighbourPair> Read(const ModelImage& image, uint32_t image_id, const std::string& query_name,
                                  const DatabaseReader& database) const;

  const QuerySelection& selection_;
  mutable LruCache<std::vector<NeighbourPair>> cache_;
};

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "colmap_lazyloc/bridge/visual_index.h"
#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/database/feature_reader.h"
#include "colmap_lazyloc/matching/options.h"

namespace lazyloc {

// COLMAP's visual index over the descriptors of a database, in one file.
class RetrievalIndex {
 public:
  struct Changes {
    size_t num_added = 0;
    size_t num_removed = 0;   // or changed; those are added again
    bool is_trained = false;  // the index was made from scratch
  };

  // Reads the index and brings it up to date with the database: images are compared by name and number of descriptors,
  // and only new and changed ones are read. The file is written if anything changed, whole or not at all. Without a
  // file (or with an empty path: in memory only) the index is made. Throws InputError, naming the file, where it is no
  // such index, is damaged, of another COLMAP generation or of another database, or cannot be written.
  RetrievalIndex(const std::filesystem::path& path, const std::vector<DatabaseImage>& images,
                 const FeatureReader& features, const RetrievalOptions& options);

  const Changes& LastChanges() const { return changes_; }
  size_t NumImages() const { return entries_.size(); }
  // Ids in the database of the images that look like the query, best first. Thread-safe.
  std::vector<uint32_t> Query(const Descriptors& query, IdleThreads* idle_threads) const;

 private:
  struct Entry {
    int32_t index_id = 0;  // in the visual index, never used again
    uint64_t num_descriptors = 0;
  };

  void Read(const std::filesystem::path& path);
  void Write(const std::filesystem::path& path) const;
  bool IsOutgrown(size_t num_images) const;
  void RemoveStaleEntries(const std::map<std::string, uint64_t>& num_descriptors);
  void AddNewEntries(const std::vector<DatabaseImage>& images, const std::map<std::string, uint64_t>& num_descriptors,
                     const FeatureReader& features, IdleThreads* idle_threads);
  void Train(const std::vector<DatabaseImage>& images, const FeatureReader& features, const RetrievalOptions& options,
             IdleThreads* idle_threads);

  std::unique_ptr<VisualIndex> visual_index_;
  std::map<std::string, Entry> entries_;  // by image name
  int32_t next_index_id_ = 1;
  Changes changes_;
  std::unordered_map<int32_t, uint32_t> image_of_index_id_;  // ids in the database
};

}  // namespace lazyloc

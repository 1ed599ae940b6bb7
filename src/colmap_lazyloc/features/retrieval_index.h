#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/database/feature_reader.h"
#include "colmap_lazyloc/features/visual_index.h"

namespace lazyloc {

struct RetrievalOptions {
  int num_visual_words = 16384;  // maximum; a small database has fewer, because too few descriptors make bad words
  int max_num_features = 1500;   // of an image or query: those of the largest scales, which suffice; -1 for all

  bool Check(std::string* error) const;
};

// What an index of all images of a database will take.
struct IndexEstimate {
  size_t num_images = 0;
  uint64_t num_features = 0;  // that are indexed
  uint64_t num_bytes = 0;

  // Returns a line for the user, with the size of the index.
  std::string Text() const;
};

// Counts the features to index; reads no descriptor.
IndexEstimate EstimateIndex(const DatabaseReader& database, const RetrievalOptions& options);

// Visual index over the descriptors of a database, stored in one file.
class RetrievalIndex {
 public:
  struct Changes {
    size_t num_added = 0;
    size_t num_removed = 0;   // includes changed images, which are added again
    bool is_trained = false;  // true if the index was made from scratch
  };

  // Reads the index and updates it to the database. Enters an image again if its descriptors have another number or
  // CRC-32 than those that were entered; leaves out images with damaged features. Reads descriptors for this only if
  // the database file has another size or time of its last change than at the last comparison, because it takes half a
  // second per million. All features must be of SIFT or ALIKED. Makes the index if the file does not exist or the path
  // is empty (then in memory only). Writes the file if anything changed, whole or not at all. num_threads: -1 for the
  // number of cores. Throws InputError naming the file if it is not such an index, is damaged, belongs to another
  // version, type of features or database, or cannot be written.
  RetrievalIndex(const std::filesystem::path& path, const DatabaseReader& database, const RetrievalOptions& options,
                 int seed, int num_threads);
  // Does the same with the features of another source than the database. images: of the database, sorted by name.
  RetrievalIndex(const std::filesystem::path& path, const std::vector<DatabaseImage>& images,
                 const FeatureSource& features, const RetrievalOptions& options, int seed, int num_threads);

  const Changes& LastChanges() const { return changes_; }
  // Returns one line for each image that was left out.
  const std::vector<std::string>& Warnings() const { return warnings_; }
  size_t NumImages() const { return entries_.size(); }
  // Returns the ids in the database of the images that look like the query, best first. Thread-safe.
  std::vector<uint32_t> Query(const Features& query, IdleThreads* idle_threads) const;

 private:
  struct Entry {
    int32_t index_id = 0;  // id in the visual index, never used again
    uint64_t num_descriptors = 0;
    uint32_t checksum = 0;  // of the descriptors
  };

  // Removes the entries of images that are gone or have other descriptors. reads_descriptors: false if those of the
  // same number are known to be the same.
  void RemoveStale(const std::vector<DatabaseImage>& images, const DescriptorCounts& counts,
                   const FeatureSource& features, bool reads_descriptors);
  void Read(const std::filesystem::path& path);
  void Write(const std::filesystem::path& path) const;
  void AddNewEntries(const std::vector<DatabaseImage>& images, const FeatureSource& features,
                     IdleThreads* idle_threads);
  // Returns the first line of the file.
  std::string Header() const;
  void Train(const std::vector<DatabaseImage>& images, const FeatureSource& features, const RetrievalOptions& options,
             IdleThreads* idle_threads);

  std::unique_ptr<VisualIndex> visual_index_;
  FeatureType type_ = FeatureType::SIFT;
  int max_num_features_ = -1;  // with which the index was made
  int seed_ = 0;
  std::string database_state_;            // of the database file with which the entries were compared
  std::map<std::string, Entry> entries_;  // by image name
  int32_t next_index_id_ = 1;
  Changes changes_;
  std::vector<std::string> warnings_;
  std::unordered_map<int32_t, uint32_t> image_of_index_id_;  // to the id in the database
};

}  // namespace lazyloc

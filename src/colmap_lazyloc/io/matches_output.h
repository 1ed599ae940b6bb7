#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "colmap_lazyloc/bridge/match_database.h"
#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/scene/features.h"
#include "colmap_lazyloc/scene/localization_problem.h"

namespace lazyloc {

// Writes the photos with their features and matches into a new COLMAP database, and the database images that they were
// matched with, under the ids of the given database. Photos get ids above these, in order of their names.
// The file appears when it is complete.
class MatchesOutput {
 public:
  // Throws InputError where the file exists or cannot be made.
  MatchesOutput(const std::filesystem::path& path, const DatabaseReader& database,
                const std::vector<std::string>& photo_names);
  // Removes what was not published.
  ~MatchesOutput();
  MatchesOutput(const MatchesOutput&) = delete;
  MatchesOutput& operator=(const MatchesOutput&) = delete;

  // database_features: one per pair of the problem. Thread-safe.
  void Write(const LocalizationProblem& problem, const Features& photo_features,
             const std::vector<std::shared_ptr<const Features>>& database_features);
  void Publish();

 private:
  void AddDatabaseImage(const ImagePair& pair, const Features& features);

  std::filesystem::path path_, staged_path_;
  std::map<std::string, DatabaseImage> database_images_;
  std::map<std::string, uint32_t> photo_ids_;
  uint32_t next_camera_id_ = 1;
  std::set<uint32_t> known_cameras_, known_images_;
  std::mutex mutex_;
  std::unique_ptr<MatchDatabase> output_;
};

}  // namespace lazyloc

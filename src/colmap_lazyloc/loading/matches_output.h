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
#include "colmap_lazyloc/files/staged_output.h"
#include "colmap_lazyloc/scene/features.h"
#include "colmap_lazyloc/scene/localization_problem.h"

namespace lazyloc {

// Writes photos with their features and matches into a new COLMAP database, together with the database images that they
// were matched with. These keep their ids; photos that the given database does not know get ids above all others, in
// the order of their names. The file appears when it is complete.
class MatchesOutput {
 public:
  // Throws InputError if the file exists or cannot be made.
  MatchesOutput(const std::filesystem::path& path, const DatabaseReader& database,
                const std::vector<std::string>& photo_names);

  // database_features: one per pair of the problem. Thread-safe.
  void Write(const LocalizationProblem& problem, const Features& photo_features,
             const std::vector<std::shared_ptr<const Features>>& database_features);
  void Publish();

 private:
  struct Ids {
    uint32_t image_id = 0, camera_id = 0;
  };

  void AddDatabaseImage(const ImagePair& pair, const Features& features);

  const std::string file_name_;
  std::map<std::string, DatabaseImage> database_images_;
  std::map<std::string, Ids> photo_ids_;
  std::set<uint32_t> known_cameras_, known_images_;
  std::mutex mutex_;
  StagedOutput staged_;
  std::unique_ptr<MatchDatabase> output_;  // destroyed before the folder that it is in
};

}  // namespace lazyloc

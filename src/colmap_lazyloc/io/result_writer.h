#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/scene/localization_result.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// Writes poses.txt, results.jsonl, model/ and options.ini into a folder, whole or not at all: everything is
// written into a staging folder inside it first and renamed into place at the end, over what an earlier run left.
class ResultWriter {
 public:
  // Makes the folder where it is missing and tries to write into it. Throws InputError naming the path where that
  // is not possible, or where a model/ is in the way that no earlier run has written: call it before any work.
  explicit ResultWriter(const std::filesystem::path& output_path);
  // Leaves nothing behind if Write was not called or failed: staging folder gone, and the folders that were made.
  ~ResultWriter();
  ResultWriter(const ResultWriter&) = delete;
  ResultWriter& operator=(const ResultWriter&) = delete;

  // results: any order; the files are sorted by query name.
  // model: the database images; its images and cameras keep ids and bits. Images that were queries may be among them,
  // but appear in model/ only with the pose that they were localized at.
  // Keypoints of the images in model/ are read from the database one image at a time.
  // Throws InputError naming the path that could not be written; what was there before is then still there.
  void Write(const Model& model, const std::vector<LocalizationResult>& results, const DatabaseReader& database,
             const std::string& options_ini);

 private:
  void MakeStagingFolder();
  void RemoveStagingFolder() noexcept;
  void CleanUp() noexcept;

  std::filesystem::path output_path_, staging_path_;
  std::vector<std::filesystem::path> made_folders_;  // innermost first
};

}  // namespace lazyloc

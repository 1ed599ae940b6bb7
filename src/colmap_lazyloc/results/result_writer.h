#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/results/leave_one_out.h"
#include "colmap_lazyloc/runs/query_records.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// Writes poses.txt, results.jsonl, positions.csv, model/, options.ini, rig_poses.txt, leave_one_out.json and
// positions.geojson into a folder, all or none, over what an earlier run left.
class ResultWriter {
 public:
  // Makes the folder if it does not exist and tries to write into it, so that a run fails before its work is done.
  // Throws InputError naming the path if that is not possible, or if there is a model/ that no earlier run has written.
  explicit ResultWriter(const std::filesystem::path& output_path);
  // Removes the folders that were made if Write was not called or failed.
  ~ResultWriter();
  ResultWriter(const ResultWriter&) = delete;
  ResultWriter& operator=(const ResultWriter&) = delete;

  // model: the database images (results/model_merger.h). leave_one_out: null if the run has none. rig_poses.txt is
  // written if a query of a rig was localized, positions.geojson if the model has an origin on Earth. staging_parent:
  // folder on the same disk for the files until they are complete; empty: the output folder. Reads records and
  // keypoints one image at a time.
  // Throws InputError naming the path that cannot be written; the folder is then as it was before.
  void Write(const Model& model, const QueryRecords& records, const DatabaseContent& database,
             const std::string& options_ini, const LeaveOneOutSummary* leave_one_out,
             const std::filesystem::path& staging_parent = {});

 private:
  void RemoveMadeFolders() noexcept;

  std::filesystem::path output_path_;
  std::vector<std::filesystem::path> made_folders_;  // innermost first
};

}  // namespace lazyloc

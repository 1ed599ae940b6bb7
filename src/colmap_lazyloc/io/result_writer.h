#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/io/query_record.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// Writes poses.txt, results.jsonl, model/, options.ini and leave_one_out.json into a folder, all or none, over what an
// earlier run left.
class ResultWriter {
 public:
  // Makes the folder if it does not exist and tries to write into it, so that a run fails before its work is done.
  // Throws InputError naming the path if that is not possible, or if there is a model/ that no earlier run has written.
  explicit ResultWriter(const std::filesystem::path& output_path);
  // Removes the folders that were made if Write was not called or failed.
  ~ResultWriter();
  ResultWriter(const ResultWriter&) = delete;
  ResultWriter& operator=(const ResultWriter&) = delete;

  // records: in any order; the files are sorted by query name.
  // model: the database images; they keep ids and bits. An image that was a query appears in model/ only with the pose
  // that it was localized at.
  // is_leave_one_out: true to write leave_one_out.json too, which compares the records with the model.
  // Reads the keypoints of the images in model/ from the database, one image at a time. Throws InputError naming the
  // path that cannot be written; the folder is then as it was before.
  void Write(const Model& model, const std::vector<QueryRecord>& records, const DatabaseReader& database,
             const std::string& options_ini, bool is_leave_one_out);

 private:
  void RemoveMadeFolders() noexcept;

  std::filesystem::path output_path_;
  std::vector<std::filesystem::path> made_folders_;  // innermost first
};

}  // namespace lazyloc

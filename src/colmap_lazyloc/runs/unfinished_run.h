#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "colmap_lazyloc/files/record_file.h"
#include "colmap_lazyloc/runs/run_manifest.h"
#include "colmap_lazyloc/scene/query_record.h"

namespace lazyloc {

// How a run begins in a folder that has an unfinished one.
enum class RunStart {
  NEW,        // refuses to
  RESUME,     // goes on with it
  OVERWRITE,  // removes it
};

// The names of the folders and files of a shard.
inline constexpr char kUnfinishedFolder[] = "unfinished";
inline constexpr char kShardFolder[] = "shard";
inline constexpr char kManifestFile[] = "manifest.json";
inline constexpr char kRecordsFile[] = "records.bin";

// What a run has finished, as files in its output folder. In `unfinished/`, until the run ends:
// - manifest.json: what the results depend on (runs/run_manifest.h)
// - records.bin: a record for each finished group (files/record_file.h, PackGroup)
// A finished shard keeps the folder as `shard/`, for the merger.
class UnfinishedRun {
 public:
  // Throws InputError saying how to go on if the folder has an unfinished run and start is NEW.
  static void CheckStart(const std::filesystem::path& output_path, RunStart start);
  // Returns the manifest of the finished shard in the folder; nullopt if there is none, or if it is unfinished.
  static std::optional<RunManifest> FinishedShard(const std::filesystem::path& output_path);

  // Begins or goes on. Throws InputError if another process writes there, if the inputs or options have changed, or if
  // nothing can be written.
  UnfinishedRun(const std::filesystem::path& output_path, const RunManifest& manifest, RunStart start);
  // Leaves nothing behind if no group was finished.
  ~UnfinishedRun();
  UnfinishedRun(const UnfinishedRun&) = delete;
  UnfinishedRun& operator=(const UnfinishedRun&) = delete;

  const std::filesystem::path& Folder() const { return folder_; }
  std::filesystem::path RecordsPath() const { return folder_ / kRecordsFile; }
  // Tells which groups an earlier process has finished, and how many queries they have.
  bool IsDone(size_t group) const { return is_done_[group]; }
  size_t NumQueriesDone() const { return num_queries_done_; }

  // Adds a finished group.
  void Append(size_t group, const std::vector<QueryRecord>& records);
  // Waits until the disk has what was appended.
  void Sync() { records_->Sync(); }
  // Ends the run, whose results are written: removes the folder, or keeps it if the run is a shard.
  void Finish();

 private:
  void Begin(RunStart start);
  void Recover();

  const std::filesystem::path output_path_, folder_;
  const RunManifest manifest_;
  std::vector<bool> is_done_;  // by group
  size_t num_queries_done_ = 0;
  bool is_empty_ = true;  // true if no group was finished
  std::unique_ptr<RecordWriter> records_;
};

}  // namespace lazyloc

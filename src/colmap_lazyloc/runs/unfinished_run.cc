#include "colmap_lazyloc/runs/unfinished_run.h"

#include <system_error>

#include "colmap_lazyloc/files/output_file.h"
#include "colmap_lazyloc/files/paths.h"
#include "colmap_lazyloc/runs/record_bytes.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;

void Rename(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::rename(from, to, error);
  if (error) throw InputError(to.string() + ": cannot be written: " + error.message());
}

uint64_t CountQueries(const fs::path& records_path) {
  uint64_t num_queries = 0;
  RecordReader reader(records_path, sizeof(PackedGroupHeader));
  while (reader.Next()) num_queries += ReadPackedGroupHeader(reader.Record()).num_queries;
  return num_queries;
}

constexpr char kHowToGoOn[] = "go on with --resume 1, or start anew with --overwrite 1";

}  // namespace

void UnfinishedRun::CheckStart(const fs::path& output_path, RunStart start) {
  const fs::path folder = output_path / kUnfinishedFolder;
  if (start != RunStart::NEW || !IsTaken(folder / kManifestFile)) return;
  const RunManifest manifest = ReadManifest(folder / kManifestFile);
  throw InputError(folder.string() + ": an unfinished run, " + std::to_string(CountQueries(folder / kRecordsFile)) +
                   " of " + std::to_string(manifest.num_own_queries) + " queries done: " + kHowToGoOn);
}

std::optional<RunManifest> UnfinishedRun::FinishedShard(const fs::path& output_path) {
  const fs::path manifest_path = output_path / kShardFolder / kManifestFile;
  if (IsTaken(output_path / kUnfinishedFolder) || !IsTaken(manifest_path)) return std::nullopt;
  RunManifest manifest = ReadManifest(manifest_path);
  if (!manifest.shard) throw InputError(manifest_path.string() + ": is the manifest of a run without shards");
  return manifest;
}

UnfinishedRun::UnfinishedRun(const fs::path& output_path, const RunManifest& manifest, RunStart start)
    : output_path_(output_path),
      folder_(output_path / kUnfinishedFolder),
      manifest_(manifest),
      is_done_(manifest.num_groups) {
  std::error_code error;
  const bool is_new = fs::create_directory(folder_, error);
  if (error) throw InputError(folder_.string() + ": cannot be made: " + error.message());
  try {
    Begin(start);
  } catch (...) {
    if (is_new) fs::remove_all(folder_, error);
    throw;
  }
}

void UnfinishedRun::Begin(RunStart start) {
  records_ = std::make_unique<RecordWriter>(RecordsPath());
  // A folder without a manifest has no records, because the manifest is written before them.
  const bool has_run = IsTaken(folder_ / kManifestFile);
  if (has_run) CheckStart(output_path_, start);
  // Removes what a process that was killed while it wrote the results has left.
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_)) {
    if (entry.is_directory()) fs::remove_all(entry.path());
  }
  if (has_run && start == RunStart::RESUME) {
    is_empty_ = false;
    Recover();
  } else {
    records_->Clear();
    const fs::path new_path = folder_ / "manifest.json.new";
    OutputFile file(new_path);
    file.Text() << manifest_.ToJson();
    file.Close();
    Rename(new_path, folder_ / kManifestFile);
  }
}

UnfinishedRun::~UnfinishedRun() {
  if (!is_empty_ || !records_) return;
  std::error_code ignored;
  fs::remove_all(folder_, ignored);
}

void UnfinishedRun::Recover() {
  const RunManifest earlier = ReadManifest(folder_ / kManifestFile);
  std::string change = manifest_.ChangeSince(earlier);
  const auto text = [](const std::optional<Shard>& shard) { return shard ? shard->Text() : ""; };
  if (change.empty() && text(manifest_.shard) != text(earlier.shard)) {
    change = "option --shard is '" + text(manifest_.shard) + "' and was '" + text(earlier.shard) + "'";
  }
  if (!change.empty()) {
    throw InputError(folder_.string() + ": the run cannot go on, because " + change + " (--overwrite 1 starts anew)");
  }
  records_->Recover([this](const std::string& record) {
    const PackedGroupHeader header = ReadPackedGroupHeader(record);
    LAZYLOC_CHECK(header.group < is_done_.size() && !is_done_[header.group]);
    is_done_[header.group] = true;
    num_queries_done_ += header.num_queries;
  });
}

void UnfinishedRun::Append(size_t group, const std::vector<QueryRecord>& records) {
  records_->Append(PackGroup(group, records));
  is_empty_ = false;
}

void UnfinishedRun::Finish() {
  is_empty_ = false;
  const fs::path shard = output_path_ / kShardFolder;
  std::error_code error;
  fs::remove_all(shard, error);  // of an earlier run
  if (manifest_.shard) {
    Rename(folder_, shard);
  } else {
    fs::remove_all(folder_, error);
  }
  if (error) throw InputError(folder_.string() + ": cannot be removed: " + error.message());
}

}  // namespace lazyloc

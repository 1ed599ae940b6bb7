#include "colmap_lazyloc/io/result_writer.h"

#include <algorithm>
#include <system_error>

#include "colmap_lazyloc/io/model_merger.h"
#include "colmap_lazyloc/io/model_writer.h"
#include "colmap_lazyloc/io/output_file.h"
#include "colmap_lazyloc/io/result_text.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;

constexpr const char* kEntries[] = {"poses.txt", "results.jsonl", "options.ini", "model"};

bool Exists(const fs::path& path) {
  std::error_code ignored;
  return fs::exists(fs::symlink_status(path, ignored));
}

void MakeFolder(const fs::path& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (error) throw InputError(path.string() + ": the folder cannot be made: " + error.message());
}

void Rename(const fs::path& from, const fs::path& to, const fs::path& published) {
  std::error_code error;
  fs::rename(from, to, error);
  if (error) throw InputError(published.string() + ": cannot be replaced: " + error.message());
}

// Puts the entries of `staged` into `output`, those that were there into `replaced`; all or none.
void Publish(const fs::path& staged, const fs::path& replaced, const fs::path& output) {
  try {
    for (const char* entry : kEntries) {
      const fs::path published = output / entry;
      if (Exists(published)) Rename(published, replaced / entry, published);
      Rename(staged / entry, published, published);
    }
  } catch (...) {
    std::error_code ignored;
    for (const char* entry : kEntries) {
      if (!Exists(staged / entry)) fs::rename(output / entry, staged / entry, ignored);
      if (Exists(replaced / entry)) fs::rename(replaced / entry, output / entry, ignored);
    }
    throw;
  }
}

std::vector<const LocalizationResult*> SortedByName(const std::vector<LocalizationResult>& results) {
  std::vector<const LocalizationResult*> sorted;
  for (const LocalizationResult& result : results) sorted.push_back(&result);
  std::sort(sorted.begin(), sorted.end(), [](const auto* a, const auto* b) { return a->query_name < b->query_name; });
  const auto has_same_name = [](const auto* a, const auto* b) { return a->query_name == b->query_name; };
  LAZYLOC_CHECK(std::adjacent_find(sorted.begin(), sorted.end(), has_same_name) == sorted.end());
  return sorted;
}

}  // namespace

ResultWriter::ResultWriter(const fs::path& output_path) : output_path_(output_path) {
  std::error_code ignored;
  if (Exists(output_path) && !fs::is_directory(output_path, ignored)) {
    throw InputError(output_path.string() + ": is not a folder");
  }
  if (Exists(output_path / "model") && !Exists(output_path / "results.jsonl")) {
    throw InputError((output_path / "model").string() +
                     ": would be replaced, but is not of an earlier run (no results.jsonl beside it)");
  }
  for (fs::path folder = output_path; !folder.empty() && !Exists(folder); folder = folder.parent_path()) {
    made_folders_.push_back(folder);
  }
  try {
    MakeFolder(output_path);
    // Only a trial: the folder is made again when there is something to write, so that an interrupted run leaves none.
    MakeStagingFolder();
    RemoveStagingFolder();
  } catch (...) {
    CleanUp();
    throw;
  }
}

ResultWriter::~ResultWriter() { CleanUp(); }

void ResultWriter::MakeStagingFolder() {
  std::error_code error;
  for (int i = 0; !error; ++i) {
    const fs::path path = output_path_ / (".lazy_localizer_staging_" + std::to_string(i));
    if (fs::create_directory(path, error)) {  // false for a name that another run has taken
      staging_path_ = path;
      return;
    }
  }
  throw InputError(output_path_.string() + ": cannot be written into: " + error.message());
}

void ResultWriter::RemoveStagingFolder() noexcept {
  std::error_code ignored;
  if (!staging_path_.empty()) fs::remove_all(staging_path_, ignored);
  staging_path_.clear();
}

void ResultWriter::CleanUp() noexcept {
  RemoveStagingFolder();
  std::error_code ignored;
  // Folders only where they are empty: somebody else may have written there since.
  for (const fs::path& folder : made_folders_) fs::remove(folder, ignored);
}

void ResultWriter::Write(const Model& model, const std::vector<LocalizationResult>& results,
                         const DatabaseReader& database, const std::string& options_ini) {
  const std::vector<const LocalizationResult*> sorted = SortedByName(results);
  MakeStagingFolder();
  const fs::path staged = staging_path_ / "new", replaced = staging_path_ / "old";
  MakeFolder(staged / "model");
  MakeFolder(replaced);
  WritePoses(staged / "poses.txt", sorted);
  WriteResultsJson(staged / "results.jsonl", sorted);
  WriteModel(staged / "model", MergeModel(model, sorted, database.ReadImages()), database);
  OutputFile options_file(staged / "options.ini");
  options_file.Text() << options_ini;
  options_file.Close();

  Publish(staged, replaced, output_path_);
  made_folders_.clear();
  RemoveStagingFolder();
}

}  // namespace lazyloc

#include "colmap_lazyloc/files/staged_output.h"

#include <system_error>
#include <utility>

#include "colmap_lazyloc/files/paths.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;

void Rename(const fs::path& from, const fs::path& to, const fs::path& published) {
  std::error_code error;
  fs::rename(from, to, error);
  if (error) throw InputError(published.string() + ": cannot be replaced: " + error.message());
}

}  // namespace

StagedOutput::StagedOutput(fs::path folder, const fs::path& wanted, fs::path staging_parent)
    : folder_(std::move(folder)) {
  if (folder_.empty()) folder_ = ".";
  if (staging_parent.empty()) staging_parent = folder_;
  std::error_code error;
  for (int i = 0; !error; ++i) {
    staging_folder_ = staging_parent / (".colmap_lazyloc_staging_" + std::to_string(i));
    if (!fs::create_directory(staging_folder_, error)) continue;  // another run has this name, or there is an error
    fs::create_directory(NewFolder(), error);
    if (!error) fs::create_directory(OldFolder(), error);
    if (!error) return;
    std::error_code ignored;
    fs::remove_all(staging_folder_, ignored);
  }
  if (!wanted.empty()) throw InputError(wanted.string() + ": cannot be written: " + error.message());
  throw InputError(folder_.string() + ": cannot be written into: " + error.message());
}

StagedOutput::~StagedOutput() {
  std::error_code ignored;
  fs::remove_all(staging_folder_, ignored);
}

void StagedOutput::Publish(const std::vector<std::string>& entries) {
  try {
    for (const std::string& entry : entries) {
      const fs::path published = folder_ / entry;
      if (IsTaken(published)) Rename(published, OldFolder() / entry, published);
      Rename(NewFolder() / entry, published, published);
    }
  } catch (...) {
    std::error_code ignored;
    for (const std::string& entry : entries) {
      if (!IsTaken(NewFolder() / entry)) fs::rename(folder_ / entry, NewFolder() / entry, ignored);
      if (IsTaken(OldFolder() / entry)) fs::rename(OldFolder() / entry, folder_ / entry, ignored);
    }
    throw;
  }
}

}  // namespace lazyloc

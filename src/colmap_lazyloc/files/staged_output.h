#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace lazyloc {

// Writes files or folders into a folder, all or none: they are written into a hidden folder first, and renamed into
// place at the end, over what was there before. An object that is destroyed before leaves nothing behind.
class StagedOutput {
 public:
  // An empty folder is the current one. Throws InputError if the folder does not exist or cannot be written into; the
  // message names `wanted`, or the folder if that is empty. staging_parent: where the hidden folder is made, on the
  // same disk; empty: in the folder.
  explicit StagedOutput(std::filesystem::path folder, const std::filesystem::path& wanted = {},
                        std::filesystem::path staging_parent = {});
  ~StagedOutput();
  StagedOutput(const StagedOutput&) = delete;
  StagedOutput& operator=(const StagedOutput&) = delete;

  // Returns the path to write an entry to.
  std::filesystem::path operator/(const std::string& entry) const { return NewFolder() / entry; }
  // Renames the entries, which must have been written, into place. Throws InputError naming the entry that cannot be
  // replaced; the folder is then as it was before.
  void Publish(const std::vector<std::string>& entries);

 private:
  std::filesystem::path NewFolder() const { return staging_folder_ / "new"; }
  std::filesystem::path OldFolder() const { return staging_folder_ / "old"; }

  std::filesystem::path folder_, staging_folder_;
};

}  // namespace lazyloc

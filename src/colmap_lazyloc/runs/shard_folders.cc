#include "colmap_lazyloc/runs/shard_folders.h"

#include <algorithm>
#include <map>
#include <system_error>
#include <utility>

#include "colmap_lazyloc/files/paths.h"
#include "colmap_lazyloc/files/text_file.h"
#include "colmap_lazyloc/runs/unfinished_run.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> ListFolders(const fs::path& path) {
  std::vector<fs::path> folders;
  std::error_code ignored;
  if (fs::is_directory(path, ignored)) {
    for (const fs::directory_entry& entry : fs::directory_iterator(path)) {
      if (entry.is_directory()) folders.push_back(entry.path());
    }
    std::sort(folders.begin(), folders.end());
    return folders;
  }
  TextFile file(path);
  while (file.NextEntry()) {
    folders.emplace_back(file.Line());
    if (!fs::is_directory(folders.back(), ignored)) throw file.Error(folders.back().string() + " is not a folder");
  }
  return folders;
}

struct FoundShard {
  fs::path folder;
  RunManifest manifest;
  bool is_finished = false;
};

// Returns the shards of all folders by index. Throws InputError for one that is doubled or of another run.
std::map<uint32_t, FoundShard> ReadShards(const std::vector<fs::path>& folders) {
  std::map<uint32_t, FoundShard> shards;
  for (const fs::path& folder : folders) {
    FoundShard shard{folder, {}, !IsTaken(folder / kUnfinishedFolder)};
    const fs::path manifest = folder / (shard.is_finished ? kShardFolder : kUnfinishedFolder) / kManifestFile;
    if (!IsTaken(manifest)) continue;  // a folder of something else
    shard.manifest = ReadManifest(manifest);
    if (!shard.manifest.shard) continue;  // an unfinished run without shards
    const uint32_t index = shard.manifest.shard->index;
    if (!shards.empty()) {
      const auto& [first_index, first] = *shards.begin();
      std::string change = shard.manifest.ChangeSince(first.manifest);
      if (change.empty() && shard.manifest.shard->count != first.manifest.shard->count) {
        change = "it is shard " + shard.manifest.shard->Text() + ", the other " + first.manifest.shard->Text();
      }
      if (!change.empty()) {
        throw InputError(folder.string() + ": is not of the same run as " + first.folder.string() + ": " + change);
      }
    }
    const auto [other, is_new] = shards.emplace(index, std::move(shard));
    if (!is_new) {
      throw InputError(folder.string() + ": is shard " + other->second.manifest.shard->Text() + ", as " +
                       other->second.folder.string() + " is");
    }
  }
  return shards;
}

}  // namespace

std::string AsRanges(const std::vector<uint32_t>& numbers) {
  std::string ranges;
  for (size_t first = 0; first < numbers.size();) {
    size_t last = first;
    while (last + 1 < numbers.size() && numbers[last + 1] == numbers[last] + 1) ++last;
    ranges += (first == 0 ? "" : ",") + std::to_string(numbers[first]);
    if (last > first) ranges += "-" + std::to_string(numbers[last]);
    first = last + 1;
  }
  return ranges;
}

ShardFolders FindShards(const fs::path& path) {
  const std::map<uint32_t, FoundShard> shards = ReadShards(ListFolders(path));
  if (shards.empty()) throw InputError(path.string() + ": no folder in it is a shard of colmap lazy_localizer --shard");
  ShardFolders found;
  found.manifest = shards.begin()->second.manifest;
  std::vector<uint32_t> missing, unfinished;
  for (uint32_t index = 1; index <= found.manifest.shard->count; ++index) {
    const auto shard = shards.find(index);
    if (shard != shards.end() && shard->second.is_finished) {
      found.records.push_back(shard->second.folder / kShardFolder / kRecordsFile);
      found.num_queries.push_back(shard->second.manifest.num_own_queries);
    } else {
      (shard == shards.end() ? missing : unfinished).push_back(index);
    }
  }
  if (missing.empty() && unfinished.empty()) return found;
  std::string message = path.string() + ": of " + std::to_string(found.manifest.shard->count) + " shards,";
  if (!missing.empty()) message += " missing: " + AsRanges(missing);
  if (!unfinished.empty()) message += (missing.empty() ? "" : ";") + (" unfinished: " + AsRanges(unfinished));
  throw InputError(message);
}

}  // namespace lazyloc

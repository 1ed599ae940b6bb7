#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// What a file or folder holds, as far as can be told without reading gigabytes: size and checksum of up to 16 MiB, of a
// larger file in evenly spaced pieces. Such a file also has its identity and the time of its last change.
struct Fingerprint {
  std::string content;  // empty: there is no such file
  std::string identity, modified;

  // True if the file has changed. A copy on another machine has not, although its times differ.
  bool IsChanged(const Fingerprint& other) const;
};

// path: a file, or a folder whose files count without those in its folders. A SQLite file counts with its -wal.
Fingerprint FingerprintOf(const std::filesystem::path& path);
// Counts all files below a folder, however many: each by its path in it, its size, and the start, middle and end of it.
Fingerprint FingerprintOfTree(const std::filesystem::path& folder);
// Depends on the values of the model, whatever the format of its files.
Fingerprint FingerprintOf(const Model& model);

// Part of a run: its groups whose names have the remainder index - 1 when their CRC-32 is divided by count.
struct Shard {
  uint32_t index = 1, count = 1;  // index: 1..count, as job arrays count

  bool Has(const std::string& group_name) const;
  std::string Text() const { return std::to_string(index) + "/" + std::to_string(count); }
};
// Returns nullopt unless the text is `index/count` with 1 <= index <= count.
std::optional<Shard> ParseShard(const std::string& text);

using OptionTexts = std::vector<std::pair<std::string, std::string>>;  // name and value

// What the results of a run depend on.
struct RunManifest {
  struct Input {
    std::string path;
    Fingerprint fingerprint;
  };

  std::string program;                  // version
  OptionTexts options;                  // that change results by their values
  std::map<std::string, Input> inputs;  // by the option that names the file; without those that are not used
  OptionTexts other_options;
  std::string extraction;                    // which features photos may have, in one line; empty without photos
  uint64_t num_groups = 0, num_queries = 0;  // of all shards
  std::optional<Shard> shard;
  uint64_t num_own_queries = 0;  // of this shard

  // Says in one sentence what has changed against an earlier manifest; empty if nothing has. The shard does not count.
  std::string ChangeSince(const RunManifest& earlier) const;
  std::string ToJson() const;
};

// Throws InputError naming the file if it is not a manifest.
RunManifest ReadManifest(const std::filesystem::path& path);

}  // namespace lazyloc

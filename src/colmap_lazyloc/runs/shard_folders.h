#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "colmap_lazyloc/runs/run_manifest.h"

namespace lazyloc {

// The finished shards of one run, in the order of their indices.
struct ShardFolders {
  RunManifest manifest;  // of the first shard
  std::vector<std::filesystem::path> records;
  std::vector<uint64_t> num_queries;  // by shard
};

// Finds the shards in the folders of a folder, or in those that the lines of a file name. Throws InputError naming
// shards that are missing, unfinished, doubled, or of another run.
ShardFolders FindShards(const std::filesystem::path& path);

// Returns ascending numbers as ranges, for example 3,7-9, as sbatch --array takes them.
std::string AsRanges(const std::vector<uint32_t>& numbers);

}  // namespace lazyloc

#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "colmap_lazyloc/loading/query_source.h"
#include "colmap_lazyloc/options/options.h"
#include "colmap_lazyloc/results/leave_one_out.h"
#include "colmap_lazyloc/results/result_writer.h"
#include "colmap_lazyloc/runs/query_records.h"
#include "colmap_lazyloc/runs/run_manifest.h"
#include "colmap_lazyloc/scene/shared_camera.h"

namespace lazyloc {

// Returns one line with an estimated camera, as options that a later run can take.
std::string DescribeCamera(const SharedCamera& shared);

// Returns the indices of the groups that belong to a shard; nullopt for all. A group has the name of its first query in
// the order of names.
std::vector<size_t> GroupsOfShard(const QuerySource& source, const std::optional<Shard>& shard);

// Returns what the results of a run depend on. model: the one at input_path, with all its images. groups: those of the
// shard.
RunManifest MakeManifest(const CommandOptions& options, const QuerySource& source, const Fingerprint& model,
                         const std::vector<size_t>& groups);

// Writes the results of a run into its output folder, and warns of queries whose intrinsics the images contradict.
// Returns the summary of a run with leave_one_out. model: the database images. options.ini names the shared cameras.
std::optional<LeaveOneOutSummary> WriteResults(const CommandOptions& options, const RunManifest& manifest,
                                               const Model& model, const DatabaseContent& database,
                                               const QueryRecords& records, const SharedCameras& shared_cameras,
                                               const std::filesystem::path& staging_parent, ResultWriter* writer);

}  // namespace lazyloc

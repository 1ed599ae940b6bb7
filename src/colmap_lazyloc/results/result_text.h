#pragma once

#include <filesystem>
#include <string>

#include "colmap_lazyloc/runs/query_records.h"
#include "colmap_lazyloc/scene/world_axes.h"

namespace lazyloc {

// The functions that write throw InputError naming the file if it cannot be written.

// Writes `name qw qx qy qz tx ty tz` of the localized queries, as hloc and visuallocalization.net read them.
void WritePoses(const std::filesystem::path& path, const QueryRecords& records);

// Writes rig_from_world of the frames with a localized query, each as its first such query states it, in the same form.
// Writes nothing if there is none.
void WriteRigPoses(const std::filesystem::path& path, const QueryRecords& records);

// axes: of the model.

// Returns the line of results.jsonl for a query, without the line break.
std::string ResultLine(const QueryRecord& record, const WorldAxes& axes);

// Writes one JSON object a line for every query. A field without a value is null.
void WriteResultsJson(const std::filesystem::path& path, const QueryRecords& records, const WorldAxes& axes);

}  // namespace lazyloc

#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

// Reads the results of a run of colmap lazy_localizer from its output folder, sorted by name: name, status, reason,
// start, confidence with its evidence, pose with its covariance, and the camera, which is that of model/ if the photo
// was localized. Other fields keep their defaults. Throws InputError naming the file if it is missing or damaged.
std::vector<LocalizationResult> ReadLocalizedResults(const std::filesystem::path& folder);

inline constexpr char kResultsFile[] = "results.jsonl";  // in an output folder

// Returns the names of the queries in a results.jsonl, as they are written there. Leaves out lines that cannot be read;
// a missing file has no names.
std::set<std::string> ReadNamesOfResults(const std::filesystem::path& path);

}  // namespace lazyloc

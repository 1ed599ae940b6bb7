#pragma once

#include <filesystem>
#include <vector>

#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

// results: sorted by name. Both throw InputError naming the file that cannot be written.

// `name qw qx qy qz tx ty tz` of the localized queries, as hloc and visuallocalization.net take them.
void WritePoses(const std::filesystem::path& path, const std::vector<const LocalizationResult*>& results);

// One JSON object a line for every query. What there is no value for is null.
void WriteResultsJson(const std::filesystem::path& path, const std::vector<const LocalizationResult*>& results);

}  // namespace lazyloc

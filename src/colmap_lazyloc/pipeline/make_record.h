#pragma once

#include <vector>

#include "colmap_lazyloc/pipeline/choose.h"
#include "colmap_lazyloc/scene/localization_result.h"
#include "colmap_lazyloc/scene/query_record.h"

namespace lazyloc {

// Returns the results of all queries of the chosen solution, without seconds.
std::vector<LocalizationResult> MakeResults(const Choice& choice, const LocalizerOptions& options);

// Returns the result of each image of a group.
std::vector<LocalizationResult> MakeResults(const std::vector<ImageChoice>& images, const LocalizerOptions& options);

// Adds the result to the record of a query as loading leaves it. The reason of a query that is not localized says what
// was left out; without any pair left, the status is DAMAGED_DATA.
void AddResult(LocalizationResult result, QueryRecord* record);
// Adds why a query could not be loaded.
void AddRefusal(const Refusal& refusal, QueryRecord* record);

}  // namespace lazyloc

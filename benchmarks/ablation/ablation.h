#pragma once

#include <string>
#include <vector>

#include "colmap_lazyloc/group/localizer_options.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/query_status.h"

namespace lazyloc {

struct AblatedResult {
  QueryStatus status = QueryStatus::LOCALIZED;
  Rigid3d cam_from_world;  // if the status is LOCALIZED
};

// Returns the names of the ablations of the paper's method: what each has instead of a stage of it.
std::vector<std::string> AblationNames();

// Localizes a single query by an ablation. Throws InputError for an unknown name.
AblatedResult LocalizeByAblation(const std::string& name, const QueryGroup& query, const LocalizerOptions& options);

}  // namespace lazyloc

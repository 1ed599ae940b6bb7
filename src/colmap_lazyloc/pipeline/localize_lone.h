#pragma once

#include "colmap_lazyloc/pipeline/options.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

// Localizes a lone query by the method that the options and the origin of its intrinsics ask for. If the score of the
// given focal length leaves a doubt, the focal length is estimated as well and decides. query: a group of one image.
LocalizationResult LocalizeLone(const QueryGroup& query, const LocalizerOptions& options);

}  // namespace lazyloc

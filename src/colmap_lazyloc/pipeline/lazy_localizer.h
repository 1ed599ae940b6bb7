#pragma once

#include "colmap_lazyloc/pipeline/options.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

// Localizes one query against posed database images (LazyLoc, arXiv 2307.09981). Uses one thread; the result depends on
// the problem and the options alone. Never throws for a query that cannot be localized: its status says why.
LocalizationResult LocalizeQuery(const LocalizationProblem& problem, const LocalizerOptions& options);

}  // namespace lazyloc

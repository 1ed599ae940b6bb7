#pragma once

#include <vector>

#include "colmap_lazyloc/pipeline/options.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

// Localizes queries together against posed database images (LazyLoc, arXiv 2307.09981): one pose for each frame.
// Returns a result for each member of the group. Uses one thread; the results depend on the group and the options
// alone. Never throws for a query that cannot be localized: its status says why. A frame that cannot be localized with
// the others is localized by itself, and they without it. Lone images whose focal length is sought are localized by
// themselves, too, and every image where the options want no adjustment over tracks. Without has_rig_scale a frame's
// lengths get the scale that its images show one by one, which adjustment refines; where fewer than two can be
// localized, each has its own result.
std::vector<LocalizationResult> LocalizeGroup(const QueryGroup& group, const LocalizerOptions& options);

// The same for a single query: a group of one frame of one image.
LocalizationResult LocalizeQuery(const LocalizationProblem& problem, const LocalizerOptions& options);

}  // namespace lazyloc

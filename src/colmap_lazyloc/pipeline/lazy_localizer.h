#pragma once

#include <vector>

#include "colmap_lazyloc/group/localizer_options.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

// Localizes queries together against posed database images (LazyLoc, arXiv 2307.09981): one pose for each frame.
// Returns a result for each image of the group. Uses one thread; the results depend on the group and the options only.
// Throws InputError for impossible options.
// Never throws for a query that cannot be localized: its status says why.
//
// Frames that cannot be localized with the others are localized individually, and the others without them. Single
// images of unknown focal length, and all images if the options exclude adjustment over tracks, are localized
// individually too. Without has_rig_scale, a frame's translations start from the scale that its images give when they
// are localized individually, and adjustment refines it; if fewer than two can be localized, the images keep their own
// results.
std::vector<LocalizationResult> LocalizeGroup(const QueryGroup& group, const LocalizerOptions& options);

// Localizes a single query: a group of one frame of one image.
LocalizationResult LocalizeQuery(const LocalizationProblem& problem, const LocalizerOptions& options);

}  // namespace lazyloc

#pragma once

#include <vector>

#include "colmap_lazyloc/pipeline/choose.h"

namespace lazyloc {

// Makes the results of a group's queries from the solution that was chosen. Nothing else sets a status, a reason or a
// confidence. seconds: of all hypotheses, which the queries share.
std::vector<LocalizationResult> MakeResults(const Choice& choice, const LocalizerOptions& options,
                                            const StageTimer::Seconds& seconds);

}  // namespace lazyloc

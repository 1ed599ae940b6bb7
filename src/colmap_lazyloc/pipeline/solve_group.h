#pragma once

#include <vector>

#include "colmap_lazyloc/pipeline/choose.h"

namespace lazyloc {

// Solves a group under each hypothesis that is worth trying, and what is left of it after some frames have failed.
// Returns the choice for each image. The group must outlive the choices. Uses one thread.
std::vector<ImageChoice> SolveGroup(const QueryGroup& group, const LocalizerOptions& options);

}  // namespace lazyloc

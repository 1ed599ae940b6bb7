#pragma once

#include "colmap_lazyloc/scene/features.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

// Lets COLMAP's commands of this process extract SIFT features by ExtractPlainSift, and match them by `match`, which
// matches as COLMAP does by default, if their options ask for no other features or matches. Pairs are verified with the
// same random numbers, whatever the number of threads. Only for the colmap program: its link replaces COLMAP's
// functions that make an extractor and a matcher, and that verify a pair.
void ReplaceSift(Matches (*match)(const Descriptors& query, const Descriptors& database));

// Names of the options that switch the GPU.
extern const char* const kExtractionUseGpuOption;
extern const char* const kMatchingUseGpuOption;

}  // namespace lazyloc

#pragma once

#include <cstddef>

#include "colmap_lazyloc/scene/features.h"

namespace lazyloc {

// Returns how many features of two images are the most similar ones of each other, and not too different: how alike the
// images look, in a fraction of the time of LightGlue. Descriptors: floats of length 1.
size_t CountMutualNeighbours(const Features& features, const Features& others);

}  // namespace lazyloc

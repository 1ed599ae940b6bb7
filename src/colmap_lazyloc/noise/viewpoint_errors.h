#pragma once

#include "colmap_lazyloc/group/layout.h"

namespace lazyloc {

// Expresses the adjusted poses relative to the database poses as given, and to the calibration that the database has
// for its rigs, because a reader of a result compares it with these. Moves the images of query frames, but the first of
// each, from the corrected to the given poses: corrections are relative to the error at the first image's viewpoint,
// and at another viewpoint the given poses have another error, because they drift. Predicts it from the corrections of
// the database frames, as kriging does (DatabasePriors). Leaves out images whose calibration the database has, because
// its rig frames have one error.
PosedImages RelativeToGivenDatabase(const Layout& layout, const PosedImages& adjusted);

}  // namespace lazyloc

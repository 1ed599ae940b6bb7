#pragma once

#include "colmap_lazyloc/group/layout.h"

namespace lazyloc {

// Returns adjusted images with what the database states: its poses, and the calibration of its rigs, with which a
// reader of a result compares it. Moves the images of query frames, but the first of each, from the corrected to these
// poses: corrections are relative to the error at the first image's viewpoint, and at another viewpoint the given poses
// have another error, because they drift. Predicts it from the corrections of the database frames, as kriging does
// (DatabasePriors). Leaves out images whose calibration the database states, because its rig frames have one error.
PosedImages AsReported(const Layout& layout, const PosedImages& adjusted);

}  // namespace lazyloc

#pragma once

#include "colmap_lazyloc/bridge/joint_adjustment.h"
#include "colmap_lazyloc/scene/joint_scene.h"

namespace lazyloc {

// Triangulates the scene's points anew and adjusts it, three times, each time with the noise of the images that the
// time before has found. Leaves out observations that do not fit, and those of images with too few of them, which keep
// their poses. Constant images and cameras keep every bit. The covariances are those of the last time.
JointAdjustment AdjustInRounds(JointScene* scene);

}  // namespace lazyloc

#pragma once

#include <vector>

#include "colmap_lazyloc/scene/joint_scene.h"

namespace lazyloc {

// Triangulates the points of the images that are not constant, from the scene's matches, with COLMAP's
// IncrementalTriangulator: it creates, continues, completes and merges tracks. Reads neither the scene's points nor the
// noise of its images. max_error_px: maximum reprojection error of an observation. The same input gives the same
// points, in the same order.
std::vector<JointPoint> TriangulateJointly(const JointScene& scene, double max_error_px);

}  // namespace lazyloc

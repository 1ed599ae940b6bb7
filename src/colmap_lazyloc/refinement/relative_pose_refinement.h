#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "colmap_lazyloc/scene/stage_summary.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Measured pose of a free view relative to a fixed one; its translation's length is unknown and not used.
struct RelativePoseEdge {
  int fixed_view = -1;
  int free_view = -1;
  Rigid3d free_from_fixed;
};

struct RelativePoseRefinementOptions {
  double max_direction_error_deg = 5;  // of an edge that agrees with a pose
  int num_samples = 10;                // poses from part of the edges that agree

  bool Check(std::string* error) const;
};

// An ablation of bundle adjustment without matches: the local optimization of Zhou et al., To Learn or Not to Learn:
// Visual Localization from Essential Matrices, ICRA 2020. An edge agrees with a pose of its free view where the
// direction from the fixed centre, by the edge's own rotation, is within max_direction_error_deg. Several edges give a
// pose: the mean of the rotations that they propose, and the point nearest to the lines on which they put the centre.
// Such poses are made of
//   the edges that agree with the view's present pose within sqrt(2) max_direction_error_deg, and
//   num_samples times, a random half (at most 14) of the edges that agree with that pose.
// The one that most edges agree with replaces the present pose; among equals, the one with the least sum of their
// errors. Zhou et al. triangulate by the direct linear transform, where an edge weighs less the more it points
// sideways.
//
// The result depends on the seed, but not on the order of the edges, of which there is one per pair of views. Those
// without translation (panoramic pairs) are not used. summary.success is false, and nothing is changed, where a free
// view has no two edges that agree and meet at an angle.
StageSummary RefineByRelativePoses(const RelativePoseRefinementOptions& options,
                                   const std::vector<RelativePoseEdge>& edges, uint32_t seed, std::vector<View>* views);

}  // namespace lazyloc

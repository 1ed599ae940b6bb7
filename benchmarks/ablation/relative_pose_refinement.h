#pragma once

#include <cstdint>
#include <vector>

#include "colmap_lazyloc/refinement/sampson_refinement.h"

namespace lazyloc {

// Measured pose of a query relative to a database image; the length of its translation is unknown and not used.
struct RelativePoseEdge {
  int database = -1;  // index into PosedImages::images
  int query = -1;     // likewise
  Rigid3d query_from_database;
};

// Refines poses by relative poses alone, an ablation of bundle adjustment: the local optimization of Zhou et al., To
// Learn or Not to Learn: Visual Localization from Essential Matrices, ICRA 2020. An edge agrees with a pose of its
// query if the direction from the database centre, by the edge's own rotation, is within five degrees. Several edges
// give a pose: the mean of the rotations that they propose, and the point nearest to the lines on which they put the
// centre. Such poses are made of
//   the edges that agree with the query's present pose within sqrt(2) times as much, and
//   ten times, a random half (at most 14) of the edges that agree with that pose.
// The one that the maximum number of edges agree with replaces the present pose; among equals, the one with the least
// sum of their errors. Zhou et al. triangulate by the direct linear transform, in which an edge weighs less the more it
// points sideways.
//
// The result depends on the seed, but not on the order of the edges, of which there is one per pair of images. Edges
// without translation (panoramic pairs) are not used. Queries must be single images. summary.success is false, and the
// poses are those of the input, if a query has no two edges that agree and meet at an angle.
PoseRefinementResult RefineByRelativePoses(const PosedImages& posed, const std::vector<RelativePoseEdge>& edges,
                                           uint32_t seed);

}  // namespace lazyloc

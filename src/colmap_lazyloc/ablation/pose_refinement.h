#pragma once

#include <cstdint>
#include <vector>

#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/stage_summary.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

struct PoseRefinementResult {
  StageSummary summary;
  PosedImages posed;
};

// Refines the pose of each query by its matches with database images, without points: an ablation of bundle adjustment
// (LazyLoc, section 3.3). Each match of a track has the epipolar error e = g / s, with g = c . (a x b), a and b the two
// rays and c the baseline, in the world, and s the standard deviation of g to first order in the noise of both
// keypoints (Sampson; Hartley & Zisserman, Multiple View Geometry, section 11.4.3). Minimises 1/2 sum k^2 log(1 + e^2 /
// k^2), k the loss scale, by Levenberg-Marquardt. Tracks need no points. Blind to false matches along the epipolar
// line, and to the position along a line of collinear cameras.
//
// Queries must be single images. summary.success is false, and the poses are those of the input, if a query has fewer
// than six matches or its cost is not finite.
// function_tolerance: minimum relative decrease of the cost by a step that is not the last.
PoseRefinementResult RefineBySampsonError(const PosedImages& posed, const std::vector<Track>& tracks,
                                          double function_tolerance = 1e-6);

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

#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "colmap_lazyloc/group/averaged.h"
#include "colmap_lazyloc/group/layout.h"
#include "colmap_lazyloc/structure/track_triangulation.h"

namespace lazyloc {

// What a start of a frame is found and scored by.
struct StartProblem {
  const PosedImages& posed;        // database poses; the frame's own pose is not used
  const TrackRefs& from_database;  // tracks of the frame with points
  const TrackRefs& rest;           // the other tracks of the frame, without points
  double max_error_px = 0;
  double min_inlier_ratio = 0.1;  // absolute poses with fewer inliers may be missed, which saves trials
  int frame = 0;
  TrackRefs from_depth = {};  // those of the rest whose point a depth map states, with this point
};

// Returns the score of a pose, a sum of max(0, 1 - log(1 + error^2) / log(1 + max_error_px^2)) over the observations of
// the frame: Cauchy's loss with a scale of one pixel, so that of two poses with as many errors within the bound, the
// one that most of them agree with exactly has the higher score. The error is the reprojection error of a point
// triangulated from the database or, at half the weight because it constrains one coordinate only, the distance from
// the epipolar line of the single database image of a track. Points from depth maps add the other half by their
// reprojection errors.
double ScoreStart(const StartProblem& problem, const Rigid3d& frame_from_world);

// Return starts, or nullopt with too few tracks: P3P in RANSAC on the tracks from the database (generalized
// P3P for a rig), the same with those from depth maps too, and the generalized relative pose over two or more pairs.
std::optional<Rigid3d> AbsolutePoseStart(const StartProblem& problem, uint32_t seed);
std::optional<Rigid3d> DepthStart(const StartProblem& problem, uint32_t seed);
std::optional<Rigid3d> GeneralizedRelativePoseStart(const StartProblem& problem, uint32_t seed);

// Poses that adjustment starts from.
struct Start {
  PosedImages posed;
  std::vector<StartPose> kinds;  // by query frame: the start that was chosen
};

// Chooses the start of each query frame by the score. Motion averaging gives a pose even if few points are seen twice;
// an absolute pose even if database centres and query are collinear; a generalized relative pose is tried if few points
// are seen twice and nothing else is certain. Throws Failure for frames without any.
//
// depth_starts: further starts from depth maps, by query frame; empty without any.
Start ChooseStart(const Layout& layout, const Averaged& averaged, const SplitTracks& tracks,
                  const LocalizerOptions& options, const std::vector<std::vector<Rigid3d>>& depth_starts = {});

}  // namespace lazyloc

#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/refinement/linear_projection.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// A view that bundle adjustment moves, with those that follow it: six parameters, and a seventh where any focal length
// or scale of a rig is sought.
struct BundleCamera {
  Rigid3d cam_from_world;
  double log_factor = 0;  // on the focal length, or on the translations within the rig
};

// A point's image in a camera that moves.
struct FreeObservation {
  int camera;
  LinearProjection projection;  // of the point in the camera's frame (of a rig: the reference camera's)
  Eigen::Vector2d residual_from_log_focal;
};

// Of an array of observations.
struct Range {
  size_t begin = 0, end = 0;
};

// Views and tracks as bundle adjustment goes through them: one after the other in memory, errors in standard
// deviations.
struct BundleProblem {
  BundleProblem(const std::vector<View>& all_views, const std::vector<Track>& tracks);

  std::vector<int> camera_of_view;  // -1 for constant views
  std::vector<const View*> views;   // of the cameras
  std::vector<BundleCamera> cameras;
  std::vector<Eigen::Vector3d> points;  // of the tracks
  std::vector<LinearProjection> fixed;  // image points in constant views, of the points in the world
  std::vector<FreeObservation> free;
  std::vector<Range> fixed_range, free_range;  // per track, in order of the cameras
};

}  // namespace lazyloc

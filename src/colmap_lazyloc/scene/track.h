#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

// A camera that observes tracks: a query whose pose is sought, or a database image whose pose is fixed.
struct View {
  Rigid3d cam_from_world;
  bool is_fixed = false;
  // Standard deviation, per coordinate, of its image points' errors: keypoint noise, and what errors of a database pose
  // and of the intrinsics look like in the image.
  double noise_px = 1;
};

struct TrackObservation {
  int view = -1;
  int keypoint = -1;  // of that view's image
  Observation observation;
};

// One scene point with its image points, at most one per view, in order of the views.
struct Track {
  std::vector<TrackObservation> observations;
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  double noise_ratio = 1;  // factor on its views' noise_px
};

}  // namespace lazyloc

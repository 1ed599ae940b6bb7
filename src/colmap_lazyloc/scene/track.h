#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/observation.h"

namespace lazyloc {

// What is known of a pose that may be off.
struct PosePrior {
  Rigid3d cam_from_world;
  double rotation_stddev_rad = 0;  // about each axis
  double position_stddev = 0;      // of each coordinate of the projection centre, in database units
};

// Of an image of a rig: the view whose pose it follows, cam_from_world = cam_from_reference * that of the reference.
struct RigLink {
  int reference = -1;  // a view before it, without a link of its own
  Rigid3d cam_from_reference;
};

// A camera that observes tracks: a query whose pose is sought, or a database image whose pose is given.
struct View {
  Rigid3d cam_from_world;
  bool is_database = false;
  // Standard deviation, per coordinate, of its image points' errors: keypoint noise, and what errors of a database pose
  // and of the intrinsics look like in the image.
  double noise_px = 1;
  // Of a database view whose pose is not taken as exact: adjustment corrects cam_from_world as far as this lets it.
  std::optional<PosePrior> prior = std::nullopt;
  // Log of the factor on the focal length that adjustment finds; none where the focal length is known.
  std::optional<double> log_focal_factor = std::nullopt;
  // None for a view with a pose of its own.
  std::optional<RigLink> rig_link = std::nullopt;
};

// Whether adjustment takes the pose as exact.
inline bool IsConstant(const View& view) { return view.is_database && !view.prior; }

// The view whose pose a view follows: itself where it has its own.
inline int ReferenceOf(const std::vector<View>& views, int view) {
  return views[view].rig_link ? views[view].rig_link->reference : view;
}

// Sets the poses of linked views from those that they follow.
inline void FollowReferences(std::vector<View>* views) {
  for (View& view : *views) {
    if (!view.rig_link) continue;
    view.cam_from_world = view.rig_link->cam_from_reference * (*views)[view.rig_link->reference].cam_from_world;
  }
}

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

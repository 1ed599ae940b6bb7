#pragma once

#include <cmath>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/refinement/linear_projection.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// A view that bundle adjustment moves, with those that follow it: six parameters, and a seventh where any focal length
// or scale of a rig is sought.
struct BundleCamera {
  explicit BundleCamera(const View& view)
      : log_factor(view.log_focal_factor.value_or(0)), factor_is_of_rig(view.seeks_rig_scale) {
    MoveTo(view.cam_from_world);
  }

  void MoveTo(const Rigid3d& pose) {
    cam_from_world = pose;
    rotation = pose.rotation.toRotationMatrix();
  }

  Rigid3d cam_from_world;
  Eigen::Matrix3d rotation;  // its matrix
  double log_factor;         // on the focal length, or on the translations within the rig
  bool factor_is_of_rig;
};

// A point's image in a camera that moves.
struct FreeObservation {
  int camera;
  LinearProjection projection;  // of the point in the camera's frame (of a rig: the reference camera's)
  Eigen::Vector2d residual_from_log_focal;
};

// A point's error in an image, and its derivatives.
struct BundleError {
  Eigen::Vector2d error;
  Eigen::Matrix<double, 2, 3> by_point;                     // in the frame of the projection
  Eigen::Vector2d by_log_factor = Eigen::Vector2d::Zero();  // of the camera
  Eigen::Vector3d rotated_point;                            // into the camera's axes

  // These are false where the point lies behind the camera.
  bool Evaluate(const LinearProjection& projection, const Eigen::Vector3d& point) {
    if (!(projection.Depth(point) > 0)) return false;
    error = projection.Error(point, &by_point);
    return true;
  }
  bool Evaluate(const FreeObservation& observation, const BundleCamera& camera, const Eigen::Vector3d& point) {
    rotated_point = camera.rotation.lazyProduct(point);
    const Eigen::Vector3d point_in_cam = rotated_point + camera.cam_from_world.translation;
    if (camera.factor_is_of_rig) {
      const LinearProjection scaled = observation.projection.WithOffset(std::exp(camera.log_factor));
      if (!Evaluate(scaled, point_in_cam)) return false;
      by_log_factor = scaled.DerivativeByLogOffset(point_in_cam, error);
      return true;
    }
    if (!Evaluate(observation.projection, point_in_cam)) return false;
    by_log_factor = observation.residual_from_log_focal;
    error += camera.log_factor * by_log_factor;
    return true;
  }

  void Scale(double factor) {
    error *= factor;
    by_point *= factor;
    by_log_factor *= factor;
  }
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

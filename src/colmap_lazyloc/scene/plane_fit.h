#pragma once

#include <Eigen/Core>

#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// A plane n . X = 1 through points in front of a camera at the origin.
struct PlaneFit {
  Eigen::MatrixX3d rays;  // to the points, unit length
  Eigen::Vector3d normal;
  Eigen::VectorXd errors;  // n . ray - 1 / distance of each point
};

// Fits a plane robustly to the points of tracks, by their inverse distances, whose errors are alike. tracks: at least
// one.
PlaneFit FitPlane(const Rigid3d& cam_from_world, const TrackRefs& tracks);

}  // namespace lazyloc

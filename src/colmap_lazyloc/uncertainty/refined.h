#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/group/query_camera.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"

namespace lazyloc {

// Variance of a component of a prior group that the covariance of an adjustment does not contain, because the
// adjustment took the component to be smaller than its result shows.
struct MissingVariance {
  size_t group, component;
  double variance;
};

// A line along which the images do not determine the position of a single query, and the variance along it by a prior.
struct UnobservableLine {
  Eigen::Vector3d direction_in_world;
  double variance;
};

// Poses after the last adjustment, and what their covariance lacks.
struct Refined {
  // Sets missing_variances by the adjustment and the variance factor.
  void SetMissingVariances();

  BundleAdjustmentResult adjustment;                  // the last one; its tracks are those that fit the result
  double variance_factor = 1;                         // of its images
  std::optional<QueryCamera> camera;                  // of a query whose focal length was estimated
  std::optional<UnobservableLine> unobservable_line;  // if a prior fixes the place on it
  std::optional<bool> has_one_orientation;            // of a single query beside one database image (ChooseOrientation)
  std::vector<MissingVariance> missing_variances;     // ForEachMissingVariance
  std::vector<std::optional<double>> rig_errors_px;   // by query (rig_check.h)
};

}  // namespace lazyloc

#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/group/query_camera.h"
#include "colmap_lazyloc/noise/database_priors.h"

namespace lazyloc {

// A line along which the images do not determine the position of a single query, and the variance along it by a prior.
struct UnobservableLine {
  Eigen::Vector3d direction_in_world;
  double variance;
};

// Poses after the last adjustment, and what their covariance lacks.
struct Refined {
  void SetMissingVariances() { missing_variances = MissingVariances(adjustment, variance_factor); }

  BundleAdjustmentResult adjustment;                  // the last one; its tracks are those that fit the result
  double variance_factor = 1;                         // of its images
  std::optional<QueryCamera> camera;                  // of a query whose focal length was estimated
  double log_focal_scatter = 0;                       // mean square deviation of estimates from other starts
  std::optional<UnobservableLine> unobservable_line;  // if a prior fixes the place on it
  std::optional<bool> has_one_orientation;            // of a single query beside one database image (choose.cc)
  std::vector<MissingVariance> missing_variances;     // by the adjustment and the variance factor
  std::vector<std::optional<double>> rig_errors_px;   // by query (rig_check.h)
};

}  // namespace lazyloc

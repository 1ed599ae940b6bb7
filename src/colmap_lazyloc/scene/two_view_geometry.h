#pragma once

#include <optional>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

// COLMAP's TwoViewGeometry::ConfigurationType, by value the same in 3.6 to 4.2.
enum class TwoViewConfig {
  UNDEFINED = 0,
  DEGENERATE = 1,
  CALIBRATED = 2,
  UNCALIBRATED = 3,
  PLANAR = 4,
  PANORAMIC = 5,
  PLANAR_OR_PANORAMIC = 6,
  WATERMARK = 7,
  MULTIPLE = 8,
  CALIBRATED_RIG = 9,
};

// Whether the geometry was verified with known intrinsics, as a relative pose needs it. UNCALIBRATED ones were verified
// by a fundamental matrix, MULTIPLE ones hold the inliers of several motions.
inline bool HoldsCalibrated(TwoViewConfig config) {
  return config == TwoViewConfig::CALIBRATED || config == TwoViewConfig::CALIBRATED_RIG ||
         config == TwoViewConfig::PLANAR || config == TwoViewConfig::PANORAMIC ||
         config == TwoViewConfig::PLANAR_OR_PANORAMIC;
}

// Verified geometry of a pair, oriented from the database image to the query: database_image first.
//   query_from_other: translation of unit length, or zero for a pair without baseline.
//   E, F, H: x_query^T E x_database = 0, likewise F in pixels; x_query ~ H x_database in pixels.
struct TwoViewGeometry {
  TwoViewConfig config = TwoViewConfig::UNDEFINED;
  Matches inlier_matches;
  std::optional<Rigid3d> query_from_other;
  std::optional<Eigen::Matrix3d> E, F, H;
  // COLMAP 4.x: the intrinsics that the geometry was estimated with, where not those of the cameras table.
  std::optional<Camera> query_camera, other_camera;
};

}  // namespace lazyloc

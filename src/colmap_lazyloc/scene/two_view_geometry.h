#pragma once

#include <optional>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

// Minimum number of verified matches of a pair that is used: COLMAP's default.
inline constexpr int kMinNumInliers = 15;

// COLMAP's TwoViewGeometry::ConfigurationType. The values are those of COLMAP 3.6 to 4.2.
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

// True if the geometry was verified with known intrinsics, because only such a geometry gives a relative pose.
// UNCALIBRATED geometries were verified with a fundamental matrix; MULTIPLE ones have the inliers of several motions.
inline bool HoldsCalibrated(TwoViewConfig config) {
  return config == TwoViewConfig::CALIBRATED || config == TwoViewConfig::CALIBRATED_RIG ||
         config == TwoViewConfig::PLANAR || config == TwoViewConfig::PANORAMIC ||
         config == TwoViewConfig::PLANAR_OR_PANORAMIC;
}

// Verified geometry of a pair, oriented from the other image to the query: COLMAP's first image is the other one.
//   query_from_other: its translation has unit length, or is zero for a pair without baseline.
//   E: x_query^T E x_other = 0 for rays in camera coordinates. F: the same equation for pixels.
//   H: x_query ~ H x_other in pixels.
struct TwoViewGeometry {
  TwoViewConfig config = TwoViewConfig::UNDEFINED;
  Matches inlier_matches;
  std::optional<Rigid3d> query_from_other;
  std::optional<Eigen::Matrix3d> E, F, H;
  // Intrinsics that COLMAP 4 estimated the geometry with; nullopt if they are those of the cameras table.
  std::optional<Camera> query_camera, other_camera;
};

// Leaves of a geometry what holds for any intrinsics, so that the calibrated one is estimated again from its inliers.
inline void ForgetIntrinsics(TwoViewGeometry* geometry) {
  geometry->config = TwoViewConfig::UNCALIBRATED;
  geometry->query_from_other.reset();
  geometry->E.reset();
}

}  // namespace lazyloc

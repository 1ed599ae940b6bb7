#pragma once

#include <optional>
#include <type_traits>
#include <vector>

#include <colmap/feature/types.h>
#include <colmap/geometry/rigid3.h>
#include <colmap/scene/camera.h>
#include <colmap/scene/two_view_geometry.h>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

inline colmap::Camera ToColmap(const Camera& camera) {
  colmap::Camera converted;
  converted.camera_id = camera.camera_id;
  converted.model_id = static_cast<colmap::CameraModelId>(camera.model_id);
  converted.width = camera.width;
  converted.height = camera.height;
  converted.params = camera.params;
  // Marks the intrinsics as known, because COLMAP treats a camera without this flag as uncalibrated.
  converted.has_prior_focal_length = true;
  return converted;
}

inline colmap::Rigid3d ToColmap(const Rigid3d& pose) { return colmap::Rigid3d(pose.rotation, pose.translation); }

// Converts a matrix [R t]. Returns nullopt if an element is not finite.
inline std::optional<Rigid3d> FiniteRigid(const Eigen::Matrix<double, 3, 4>& matrix) {
  const Eigen::Quaterniond rotation(Eigen::Matrix3d(matrix.leftCols<3>()));
  const Eigen::Vector3d translation = matrix.col(3);
  if (!rotation.coeffs().allFinite() || !translation.allFinite()) return std::nullopt;
  return Rigid3d{rotation.normalized(), translation};
}

inline std::optional<Rigid3d> FiniteRigid(const colmap::Rigid3d& pose) { return FiniteRigid(pose.ToMatrix()); }

// Converts matches; COLMAP's first image is the other one, its second image is the query.
inline colmap::FeatureMatches ToColmap(const Matches& matches) {
  colmap::FeatureMatches converted;
  converted.reserve(matches.size());
  for (const Match& match : matches) converted.emplace_back(match.other_point, match.query_point);
  return converted;
}

// Converts rays to the type of estimators of essential matrices: points in the plane z = 1 in COLMAP 3, the rays
// themselves in COLMAP 4.
template <typename Point>
std::vector<Point> ToEstimator(const std::vector<Eigen::Vector3d>& rays_in_cam) {
  std::vector<Point> points;
  for (const Eigen::Vector3d& ray : rays_in_cam) {
    if constexpr (std::is_same_v<Point, Eigen::Vector2d>) {
      points.push_back(ray.hnormalized());
    } else {
      points.push_back(ray);
    }
  }
  return points;
}

// Returns cam2_from_cam1 of a geometry, nullopt if COLMAP has not set it or if it is not finite.
std::optional<Rigid3d> RelativePose(const colmap::TwoViewGeometry& geometry);

}  // namespace lazyloc

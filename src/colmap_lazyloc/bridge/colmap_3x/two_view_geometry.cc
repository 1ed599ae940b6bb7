#include "colmap_lazyloc/bridge/two_view_geometry.h"

#include <colmap/estimators/two_view_geometry.h>
#include <colmap/math/random.h>

#include "colmap_lazyloc/bridge/colmap_3x/convert.h"

namespace lazyloc {
namespace {

// Zeros stand for a matrix that is not set.
std::optional<Eigen::Matrix3d> IfSet(const Eigen::Matrix3d& matrix) {
  return matrix.isZero(0) ? std::nullopt : std::make_optional(matrix);
}

TwoViewGeometry FromColmap(const colmap::TwoViewGeometry& geometry) {
  TwoViewGeometry converted;
  converted.config = static_cast<TwoViewConfig>(geometry.config);
  converted.E = IfSet(geometry.E);
  converted.F = IfSet(geometry.F);
  converted.H = IfSet(geometry.H);
  for (const colmap::FeatureMatch& match : geometry.inlier_matches) {
    converted.inlier_matches.push_back({match.point2D_idx2, match.point2D_idx1});
  }
  return converted;
}

bool HasPose(const colmap::TwoViewGeometry& geometry) {
  const colmap::Rigid3d& pose = geometry.cam2_from_cam1;
  return pose.rotation.coeffs().allFinite() && pose.rotation.norm() > 0 && pose.translation.allFinite();
}

}  // namespace

TwoViewGeometry EstimateTwoViewGeometry(const Camera& database_camera,
                                        const std::vector<Eigen::Vector2d>& database_keypoints,
                                        const Camera& query_camera, const std::vector<Eigen::Vector2d>& query_keypoints,
                                        const Matches& matches, const TwoViewGeometryOptions& options, uint32_t seed) {
  colmap::TwoViewGeometryOptions colmap_options;
  colmap_options.min_num_inliers = options.min_num_inliers;
  colmap_options.ransac_options.max_error = options.max_error_px;
  // RANSAC draws from a generator of the thread's.
  colmap::SetPRNGSeed(seed);
  const colmap::Camera camera1 = ToColmap(database_camera), camera2 = ToColmap(query_camera);
  colmap::TwoViewGeometry geometry = colmap::EstimateCalibratedTwoViewGeometry(
      camera1, database_keypoints, camera2, query_keypoints, ToColmap(matches), colmap_options);
  const bool has_pose =
      colmap::EstimateTwoViewGeometryPose(camera1, database_keypoints, camera2, query_keypoints, &geometry);
  TwoViewGeometry result = FromColmap(geometry);
  if (has_pose && HasPose(geometry)) result.query_from_database = FromColmap(geometry.cam2_from_cam1);
  return result;
}

void EstimateRelativePose(const Camera& database_camera, const std::vector<Eigen::Vector2d>& database_keypoints,
                          const Camera& query_camera, const std::vector<Eigen::Vector2d>& query_keypoints,
                          TwoViewGeometry* geometry) {
  colmap::TwoViewGeometry converted;
  converted.config = static_cast<colmap::TwoViewGeometry::ConfigurationType>(geometry->config);
  const bool has_model =
      geometry->config == TwoViewConfig::CALIBRATED ? geometry->E.has_value() : geometry->H.has_value();
  if (!has_model) return;
  if (geometry->E) converted.E = *geometry->E;
  if (geometry->H) converted.H = *geometry->H;
  converted.inlier_matches = ToColmap(geometry->inlier_matches);
  if (!colmap::EstimateTwoViewGeometryPose(ToColmap(database_camera), database_keypoints, ToColmap(query_camera),
                                           query_keypoints, &converted) ||
      !HasPose(converted)) {
    return;
  }
  geometry->config = static_cast<TwoViewConfig>(converted.config);
  geometry->query_from_database = FromColmap(converted.cam2_from_cam1);
}

}  // namespace lazyloc

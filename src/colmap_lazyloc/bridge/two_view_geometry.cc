#include "colmap_lazyloc/bridge/two_view_geometry.h"

#include <colmap/estimators/two_view_geometry.h>
#include <colmap/math/random.h>

#include "colmap_lazyloc/bridge/convert.h"

namespace lazyloc {
namespace {

// Intrinsics are known, so that a fundamental matrix which more matches agree with has only gathered wrong ones, of
// like windows for instance. COLMAP asks for 0.95, as that may show it wrong intrinsics.
constexpr double kMinCalibratedInlierRatio = 0.5;

// In COLMAP 3 zeros stand for a matrix that is not set.
std::optional<Eigen::Matrix3d> IfSet(std::optional<Eigen::Matrix3d> matrix) {
  if (matrix && matrix->isZero(0)) matrix.reset();
  return matrix;
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

}  // namespace

TwoViewGeometry EstimateTwoViewGeometry(const Camera& database_camera,
                                        const std::vector<Eigen::Vector2d>& database_keypoints,
                                        const Camera& query_camera, const std::vector<Eigen::Vector2d>& query_keypoints,
                                        const Matches& matches, const TwoViewGeometryOptions& options, uint32_t seed) {
  colmap::TwoViewGeometryOptions colmap_options;
  colmap_options.min_num_inliers = options.min_num_inliers;
  colmap_options.ransac_options.max_error = options.max_error_px;
  colmap_options.min_E_F_inlier_ratio = kMinCalibratedInlierRatio;
  // RANSAC draws from a generator of the thread's.
  colmap::SetPRNGSeed(seed);
  const colmap::Camera camera1 = ToColmap(database_camera);
  colmap::Camera camera2 = ToColmap(query_camera);
  camera2.has_prior_focal_length = options.is_query_calibrated;
  colmap::TwoViewGeometry geometry = colmap::EstimateTwoViewGeometry(
      camera1, database_keypoints, camera2, query_keypoints, ToColmap(matches), colmap_options);
  if (!options.is_query_calibrated) return FromColmap(geometry);
  const bool has_pose =
      colmap::EstimateTwoViewGeometryPose(camera1, database_keypoints, camera2, query_keypoints, &geometry);
  TwoViewGeometry result = FromColmap(geometry);
  if (has_pose) result.query_from_database = RelativePose(geometry);
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
                                           query_keypoints, &converted)) {
    return;
  }
  const std::optional<Rigid3d> pose = RelativePose(converted);
  if (!pose) return;
  geometry->config = static_cast<TwoViewConfig>(converted.config);
  geometry->query_from_database = pose;
}

}  // namespace lazyloc

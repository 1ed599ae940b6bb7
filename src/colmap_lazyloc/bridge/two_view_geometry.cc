#include "colmap_lazyloc/bridge/two_view_geometry.h"

#include <cmath>

#if __has_include(<colmap/estimators/solvers/essential_matrix.h>)
#include <colmap/estimators/solvers/essential_matrix.h>  // COLMAP 4
#include <colmap/geometry/essential_matrix.h>
#else
#include <colmap/estimators/essential_matrix.h>
#include <colmap/estimators/utils.h>
#endif
#include <colmap/estimators/two_view_geometry.h>
#include <colmap/optim/loransac.h>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/bridge/random_numbers.h"
#include "colmap_lazyloc/bridge/ray_geometry.h"
#include "colmap_lazyloc/scene/equirectangular.h"

namespace lazyloc {
namespace {

// Minimum ratio between the inliers of the essential and of the fundamental matrix for a calibrated geometry. COLMAP's
// default is 0.95, because more inliers of the fundamental matrix may be a sign of wrong intrinsics. Here the
// intrinsics are known, so that these inliers are wrong matches, for example between similar windows.
constexpr double kMinCalibratedInlierRatio = 0.5;

// Maximum number of matches for the choice among the four poses of an essential matrix. COLMAP triangulates all matches
// with each pose to find the one with points in front of both cameras; this takes longer than everything else, and so
// many matches give the same answer.
constexpr size_t kNumMatchesForSigns = 50;

// Adds the squared Sampson errors, which COLMAP 4.2 has no longer in its solver.
struct FivePoints : colmap::EssentialMatrixFivePointEstimator {
  static void Residuals(const std::vector<X_t>& other_points, const std::vector<Y_t>& query_points, const M_t& E,
                        std::vector<double>* squared_errors) {
    colmap::ComputeSquaredSampsonError(other_points, query_points, E, squared_errors);
  }
};

// Returns at most max_num of the matches, evenly spaced in their order.
Matches Some(const Matches& matches, size_t max_num) {
  if (matches.size() <= max_num) return matches;
  Matches chosen;
  for (size_t i = 0; i < max_num; ++i) chosen.push_back(matches[i * matches.size() / max_num]);
  return chosen;
}

// Returns nullopt for a zero matrix, because COLMAP 3 stores zeros for a matrix that is not set.
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

// Returns COLMAP's maximum epipolar error of an inlier in pixels.
double MaxErrorPx() { return colmap::TwoViewGeometryOptions().ransac_options.max_error; }

}  // namespace

TwoViewGeometry EstimateTwoViewGeometry(const Camera& other_camera, const std::vector<Eigen::Vector2d>& other_keypoints,
                                        const Camera& query_camera, const std::vector<Eigen::Vector2d>& query_keypoints,
                                        const Matches& matches, bool is_query_calibrated, uint32_t seed) {
  if (IsEquirectangular(other_camera) || IsEquirectangular(query_camera)) {
    return EstimateRayGeometry(other_camera, other_keypoints, query_camera, query_keypoints, matches, MaxErrorPx(),
                               seed);
  }
  colmap::TwoViewGeometryOptions colmap_options;
  colmap_options.min_num_inliers = kMinNumInliers;
  colmap_options.min_E_F_inlier_ratio = kMinCalibratedInlierRatio;
  SeedRandomNumbers(seed);
  const colmap::Camera camera1 = ToColmap(other_camera);
  colmap::Camera camera2 = ToColmap(query_camera);
  camera2.has_prior_focal_length = is_query_calibrated;
  colmap::TwoViewGeometry geometry = colmap::EstimateTwoViewGeometry(camera1, other_keypoints, camera2, query_keypoints,
                                                                     ToColmap(matches), colmap_options);
  if (!is_query_calibrated) return FromColmap(geometry);
  const bool has_pose =
      colmap::EstimateTwoViewGeometryPose(camera1, other_keypoints, camera2, query_keypoints, &geometry);
  TwoViewGeometry result = FromColmap(geometry);
  if (has_pose) result.query_from_other = RelativePose(geometry);
  return result;
}

TwoViewGeometry EstimateCalibratedGeometry(const Camera& other_camera,
                                           const std::vector<Eigen::Vector2d>& other_keypoints,
                                           const Camera& query_camera,
                                           const std::vector<Eigen::Vector2d>& query_keypoints,
                                           const TwoViewGeometry& stored, uint32_t seed) {
  const RayInCamFunction other_ray = RaysInCam(other_camera), query_ray = RaysInCam(query_camera);
  std::vector<FivePoints::X_t> other_points, query_points;
  Matches with_rays;
  for (const Match& match : stored.inlier_matches) {
    const std::optional<Eigen::Vector3d> ray1 = other_ray(other_keypoints[match.other_point]),
                                         ray2 = query_ray(query_keypoints[match.query_point]);
    if (!ray1 || !ray2) continue;
    other_points.push_back(ToEstimator<FivePoints::X_t>(*ray1));
    query_points.push_back(ToEstimator<FivePoints::X_t>(*ray2));
    with_rays.push_back(match);
  }
  colmap::RANSACOptions ransac_options;
  const double max_error_px = MaxErrorPx();
  ransac_options.max_error = (ToColmap(other_camera).CamFromImgThreshold(max_error_px) +
                              ToColmap(query_camera).CamFromImgThreshold(max_error_px)) /
                             2;
  ransac_options.min_inlier_ratio = kMinCalibratedInlierRatio;
  // Takes few trials, because local optimization mends the best one, and the matches are inliers of one geometry.
  ransac_options.confidence = 0.99;
  ransac_options.dyn_num_trials_multiplier = 1;
  ransac_options.min_num_trials = 5;
  TwoViewGeometry geometry;
  // Takes an essential matrix if it has enough inliers.
  const auto take = [&](const Eigen::Matrix3d& E) {
    std::vector<double> squared_errors;
    FivePoints::Residuals(other_points, query_points, E, &squared_errors);
    geometry.E = E;
    geometry.inlier_matches.clear();
    for (size_t i = 0; i < with_rays.size(); ++i) {
      if (squared_errors[i] <= std::pow(ransac_options.max_error, 2)) geometry.inlier_matches.push_back(with_rays[i]);
    }
    return geometry.inlier_matches.size() >= kMinCalibratedInlierRatio * stored.inlier_matches.size();
  };
  if (!stored.E || !take(*stored.E)) {
    SeedRandomNumbers(seed);
    const auto report = colmap::LORANSAC<FivePoints, FivePoints>(ransac_options).Estimate(other_points, query_points);
    if (!report.success || !take(report.model)) return {};
  }
  geometry.config = TwoViewConfig::CALIBRATED;
  EstimateRelativePose(other_camera, other_keypoints, query_camera, query_keypoints, &geometry);
  return geometry;
}

void EstimateRelativePose(const Camera& other_camera, const std::vector<Eigen::Vector2d>& other_keypoints,
                          const Camera& query_camera, const std::vector<Eigen::Vector2d>& query_keypoints,
                          TwoViewGeometry* geometry) {
  colmap::TwoViewGeometry converted;
  converted.config = static_cast<colmap::TwoViewGeometry::ConfigurationType>(geometry->config);
  const bool has_model =
      geometry->config == TwoViewConfig::CALIBRATED ? geometry->E.has_value() : geometry->H.has_value();
  if (!has_model) return;
  if (geometry->E) converted.E = *geometry->E;
  if (geometry->H) converted.H = *geometry->H;
  converted.inlier_matches =
      ToColmap(geometry->config == TwoViewConfig::CALIBRATED ? Some(geometry->inlier_matches, kNumMatchesForSigns)
                                                             : geometry->inlier_matches);
  if (!colmap::EstimateTwoViewGeometryPose(ToColmap(other_camera), other_keypoints, ToColmap(query_camera),
                                           query_keypoints, &converted)) {
    return;
  }
  const std::optional<Rigid3d> pose = RelativePose(converted);
  if (!pose) return;
  geometry->config = static_cast<TwoViewConfig>(converted.config);
  geometry->query_from_other = pose;
}

}  // namespace lazyloc

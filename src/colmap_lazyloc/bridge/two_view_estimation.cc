#include "colmap_lazyloc/bridge/two_view_estimation.h"

#include <algorithm>
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

// Minimum number of RANSAC's trials with known intrinsics. COLMAP's default of 100, and three times the trials that its
// confidence of 0.999 needs, take most of a query's time, but give the same poses.
constexpr int kMinNumTrials = 10;

// Maximum of the inlier ratio that RANSAC counts on, so that noise in its samples does not end it too early.
constexpr double kMaxExpectedInlierRatio = 0.75;

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
Matches Subsample(const Matches& matches, size_t max_num) {
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

// Returns COLMAP's maximum epipolar error of an inlier in pixels.
double MaxErrorPx() { return colmap::TwoViewGeometryOptions().ransac_options.max_error; }

}  // namespace

double MaxErrorRad(const Camera& query_camera, const Camera& other_camera) {
  return (MaxErrorPx() / MeanFocalLength(other_camera) + MaxErrorPx() / MeanFocalLength(query_camera)) / 2;
}

TwoViewGeometry EstimateTwoViewGeometry(const LocalizationProblem& problem, const ImagePair& pair,
                                        const Matches& matches, bool is_query_calibrated, uint32_t seed) {
  if (IsEquirectangular(pair.other_camera) || IsEquirectangular(problem.query_camera)) {
    return EstimateRayGeometry(problem, pair, matches, MaxErrorPx(), seed);
  }
  colmap::TwoViewGeometryOptions colmap_options;
  colmap_options.min_num_inliers = kMinNumInliers;
  colmap_options.min_E_F_inlier_ratio = kMinCalibratedInlierRatio;
  colmap::RANSACOptions& ransac_options = colmap_options.ransac_options;
  if (is_query_calibrated) {
    ransac_options.min_num_trials = kMinNumTrials;
    ransac_options.dyn_num_trials_multiplier = 1;
    // Does not look for fewer inliers than a pair needs: in a pair of a few wrong matches, this saves nearly all
    // trials.
    const double needed_ratio = kMinNumInliers / std::max(static_cast<double>(matches.size()), 1.0);
    ransac_options.min_inlier_ratio =
        std::max(ransac_options.min_inlier_ratio, std::min(needed_ratio, kMaxExpectedInlierRatio));
  }
  SeedRandomNumbers(seed);
  const colmap::Camera camera1 = ToColmap(pair.other_camera);
  colmap::Camera camera2 = ToColmap(problem.query_camera);
  camera2.has_prior_focal_length = is_query_calibrated;
  const colmap::TwoViewGeometry geometry = colmap::EstimateTwoViewGeometry(
      camera1, pair.other_keypoints, camera2, problem.query_keypoints, ToColmap(matches), colmap_options);
  TwoViewGeometry result;
  result.config = static_cast<TwoViewConfig>(geometry.config);
  result.E = IfSet(geometry.E);
  result.F = IfSet(geometry.F);
  result.H = IfSet(geometry.H);
  for (const colmap::FeatureMatch& match : geometry.inlier_matches) {
    result.inlier_matches.push_back({match.point2D_idx2, match.point2D_idx1});
  }
  if (is_query_calibrated && HoldsCalibrated(result.config)) EstimateRelativePose(problem, pair, &result);
  return result;
}

TwoViewGeometry EstimateCalibratedGeometry(const LocalizationProblem& problem, const ImagePair& pair, uint32_t seed) {
  const TwoViewGeometry& stored = *pair.geometry;
  const MatchedRays rays = RaysOfMatches(problem, pair, stored.inlier_matches);
  const auto other_points = ToEstimator<FivePoints::X_t>(rays.other),
             query_points = ToEstimator<FivePoints::X_t>(rays.query);
  colmap::RANSACOptions ransac_options;
  ransac_options.max_error = MaxErrorRad(problem.query_camera, pair.other_camera);
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
    for (size_t i = 0; i < rays.matches.size(); ++i) {
      if (squared_errors[i] <= std::pow(ransac_options.max_error, 2))
        geometry.inlier_matches.push_back(rays.matches[i]);
    }
    return geometry.inlier_matches.size() >= kMinCalibratedInlierRatio * stored.inlier_matches.size();
  };
  if (!stored.E || !take(*stored.E)) {
    SeedRandomNumbers(seed);
    const auto report = colmap::LORANSAC<FivePoints, FivePoints>(ransac_options).Estimate(other_points, query_points);
    if (!report.success || !take(report.model)) return {};
  }
  geometry.config = TwoViewConfig::CALIBRATED;
  EstimateRelativePose(problem, pair, &geometry);
  return geometry;
}

void EstimateRelativePose(const LocalizationProblem& problem, const ImagePair& pair, TwoViewGeometry* geometry) {
  const bool is_calibrated = geometry->config == TwoViewConfig::CALIBRATED;
  if (!(is_calibrated ? geometry->E : geometry->H)) return;
  colmap::TwoViewGeometry converted;
  converted.config = static_cast<colmap::TwoViewGeometry::ConfigurationType>(geometry->config);
  if (geometry->E) converted.E = *geometry->E;
  if (geometry->H) converted.H = *geometry->H;
  converted.inlier_matches =
      ToColmap(is_calibrated ? Subsample(geometry->inlier_matches, kNumMatchesForSigns) : geometry->inlier_matches);
  if (!colmap::EstimateTwoViewGeometryPose(ToColmap(pair.other_camera), pair.other_keypoints,
                                           ToColmap(problem.query_camera), problem.query_keypoints, &converted)) {
    return;
  }
  const std::optional<Rigid3d> pose = RelativePose(converted);
  if (!pose) return;
  geometry->config = static_cast<TwoViewConfig>(converted.config);
  geometry->query_from_other = pose;
}

}  // namespace lazyloc

#include "colmap_lazyloc/bridge/ray_geometry.h"

#include <algorithm>
#include <cmath>

#if __has_include(<colmap/estimators/solvers/essential_matrix.h>)
#include <colmap/estimators/solvers/essential_matrix.h>  // COLMAP 4
#else
#include <colmap/estimators/essential_matrix.h>
#endif
#include <colmap/optim/loransac.h>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/bridge/random_numbers.h"

namespace lazyloc {
namespace {

constexpr double kMinDepth = 1e-3;       // |z| of rays that COLMAP 3 can project to the plane z = 1
constexpr double kPanoramicRatio = 0.8;  // of the inliers that a rotation explains, for a pair without baseline

struct FivePoints {
  using X_t = Eigen::Vector3d;
  using Y_t = Eigen::Vector3d;
  using M_t = Eigen::Matrix3d;
  static constexpr int kMinNumSamples = 5;

  static void Estimate(const Rays& other, const Rays& query, std::vector<M_t>* models) {
    using Solver = colmap::EssentialMatrixFivePointEstimator;
    models->clear();
    const auto is_flat = [](const Eigen::Vector3d& ray) { return std::abs(ray.z()) < kMinDepth; };
    if (std::any_of(other.begin(), other.end(), is_flat) || std::any_of(query.begin(), query.end(), is_flat)) return;
    Solver::Estimate(ToEstimator<Solver::X_t>(other), ToEstimator<Solver::X_t>(query), models);
  }
  static void Residuals(const Rays& other, const Rays& query, const M_t& E, std::vector<double>* residuals) {
    *residuals = SquaredEpipolarErrors(other, query, E);
  }
};

struct AllPoints : FivePoints {
  static constexpr int kMinNumSamples = 8;
  static void Estimate(const Rays& other, const Rays& query, std::vector<M_t>* models) {
    *models = {FitEssentialMatrix(other, query)};
  }
};

}  // namespace

MatchedRays RaysOfMatches(const LocalizationProblem& problem, const ImagePair& pair, const Matches& matches) {
  const RayInCamFunction other_ray = RaysInCam(pair.other_camera), query_ray = RaysInCam(problem.query_camera);
  MatchedRays rays;
  for (const Match& match : matches) {
    const std::optional<Eigen::Vector3d> other = other_ray(pair.other_keypoints[match.other_point]),
                                         query = query_ray(problem.query_keypoints[match.query_point]);
    if (!other || !query) continue;
    rays.other.push_back(*other);
    rays.query.push_back(*query);
    rays.matches.push_back(match);
  }
  return rays;
}

TwoViewGeometry EstimateRayGeometry(const LocalizationProblem& problem, const ImagePair& pair, const Matches& matches,
                                    double max_error_px, uint32_t seed) {
  const auto [with_rays, other, query] = RaysOfMatches(problem, pair, matches);
  TwoViewGeometry geometry;
  geometry.config = TwoViewConfig::DEGENERATE;
  if (static_cast<int>(with_rays.size()) < kMinNumInliers) return geometry;
  colmap::RANSACOptions options;
  options.max_error =
      max_error_px * (1 / MeanFocalLength(pair.other_camera) + 1 / MeanFocalLength(problem.query_camera)) / 2;
  options.min_inlier_ratio = 0.25;
  options.confidence = 0.999;
  SeedRandomNumbers(seed);
  const auto report = colmap::LORANSAC<FivePoints, AllPoints>(options).Estimate(other, query);
  if (!report.success || static_cast<int>(report.support.num_inliers) < kMinNumInliers) return geometry;
  Rays other_inliers, query_inliers;
  for (size_t i = 0; i < with_rays.size(); ++i) {
    if (!report.inlier_mask[i]) continue;
    geometry.inlier_matches.push_back(with_rays[i]);
    other_inliers.push_back(other[i]);
    query_inliers.push_back(query[i]);
  }
  geometry.E = report.model;
  const Eigen::Quaterniond rotation = FitRotationOfRays(other_inliers, query_inliers);
  double num_turned = 0;
  for (size_t i = 0; i < other_inliers.size(); ++i) {
    num_turned += (rotation * other_inliers[i] - query_inliers[i]).norm() <= options.max_error;
  }
  const bool is_panoramic = num_turned >= kPanoramicRatio * static_cast<double>(other_inliers.size());
  geometry.config = is_panoramic ? TwoViewConfig::PANORAMIC : TwoViewConfig::CALIBRATED;
  geometry.query_from_other = is_panoramic ? Rigid3d{rotation, Eigen::Vector3d::Zero()}
                                           : PoseOfEssentialMatrix(report.model, other_inliers, query_inliers);
  return geometry;
}

}  // namespace lazyloc

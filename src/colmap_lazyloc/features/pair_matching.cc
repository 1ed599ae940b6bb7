#include "colmap_lazyloc/features/pair_matching.h"

#include <algorithm>
#include <numeric>
#include <optional>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/bridge/two_view_estimation.h"
#include "colmap_lazyloc/features/feature_statistics.h"
#include "colmap_lazyloc/math/seed.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/equirectangular.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Number of features of an image that are compared first.
constexpr size_t kNumLargest = 1000;

// Features of an image with their places among all of its features.
struct Subset {
  Features features;
  std::vector<size_t> places;
};

Subset LargestFeatures(const Features& all) {
  Subset largest;
  largest.places = IndicesOfLargest(all.keypoints, kNumLargest);
  largest.features.type = all.type;
  largest.features.descriptors.resize(static_cast<Eigen::Index>(largest.places.size()), all.descriptors.cols());
  for (const size_t place : largest.places) {
    const auto row = static_cast<Eigen::Index>(largest.features.keypoints.size());
    largest.features.descriptors.row(row) = all.descriptors.row(static_cast<Eigen::Index>(place));
    largest.features.keypoints.push_back(all.keypoints[place]);
  }
  return largest;
}

// Returns the camera that a pair's geometry holds for: a fundamental matrix knows no distortion.
Camera CameraOfGeometry(const Camera& camera, bool is_calibrated) {
  if (is_calibrated) return camera;
  const double focal_length_px = MeanFocalLength(camera);
  const Eigen::Vector2d centre = PrincipalPoint(camera);
  return {0,
          *CameraModelId("PINHOLE"),
          camera.width,
          camera.height,
          {focal_length_px, focal_length_px, centre.x(), centre.y()},
          true};
}

Eigen::Matrix3d CalibrationMatrix(const Camera& camera) {
  const Eigen::Vector2d centre = PrincipalPoint(camera);
  Eigen::Matrix3d matrix = Eigen::Vector3d(MeanFocalLength(camera), MeanFocalLength(camera), 1).asDiagonal();
  matrix.topRightCorner<2, 1>() = centre;
  return matrix;
}

// Returns the essential matrix of the cameras of a pair's geometry. nullopt if it has none, or no baseline.
std::optional<Eigen::Matrix3d> EssentialMatrix(const TwoViewGeometry& geometry, const Camera& query_camera,
                                               const Camera& other_camera, bool is_calibrated) {
  if (!is_calibrated) {
    if (!geometry.F) return std::nullopt;
    return CalibrationMatrix(query_camera).transpose() * *geometry.F * CalibrationMatrix(other_camera);
  }
  const std::optional<Rigid3d>& pose = geometry.query_from_other;
  if (!pose || pose->translation.isZero()) return std::nullopt;
  return Hat(pose->translation) * pose->rotation.toRotationMatrix();
}

// Returns a ray per point, zero where the camera has none.
Rays RaysOf(const Camera& camera, const std::vector<Eigen::Vector2d>& points) {
  const RayInCamFunction ray_in_cam = RaysInCam(camera);
  Rays rays;
  rays.reserve(points.size());
  for (const Eigen::Vector2d& point : points) rays.push_back(ray_in_cam(point).value_or(Eigen::Vector3d::Zero()));
  return rays;
}

TwoViewGeometry Verify(const LocalizationProblem& problem, const ImagePair& pair, int seed) {
  // A wrong focal length loses right matches, so that one that nobody has stated must not choose them.
  const bool is_calibrated = IsCalibrated(problem.intrinsics_origin);
  TwoViewGeometry geometry;
  if (static_cast<int>(pair.matches.size()) >= kMinNumInliers) {
    geometry = EstimateTwoViewGeometry(problem, pair, pair.matches, is_calibrated,
                                       SeedFromNames(problem.query_name, pair.other_name, seed));
  }
  // Marks the pair as unusable, because nothing more can be found in these matches.
  const bool is_usable =
      HoldsCalibrated(geometry.config) || (!is_calibrated && geometry.config == TwoViewConfig::UNCALIBRATED);
  if (!is_usable) geometry.config = TwoViewConfig::DEGENERATE;
  return geometry;
}

// Compares the largest features of the query with those of a database image.
Matches MatchLargest(const FeatureMethod& method, const LocalizationProblem& problem, const Subset& query,
                     const ImagePair& pair, const Features& database) {
  const Subset other = LargestFeatures(database);
  Matches matches = method.Match(query.features, problem.query_camera, other.features, pair.other_camera);
  for (Match& match : matches) {
    match.query_point = static_cast<uint32_t>(query.places[match.query_point]);
    match.other_point = static_cast<uint32_t>(other.places[match.other_point]);
  }
  return matches;
}

// Replaces the matches of a verified pair by those of all features along the epipolar lines of its geometry.
void MatchGuided(const FeatureMethod& method, const LocalizationProblem& problem, const Features& query,
                 const Rays& query_rays, const Features& database, ImagePair* pair) {
  const bool is_calibrated = IsCalibrated(problem.intrinsics_origin);
  const auto E = EssentialMatrix(*pair->geometry, problem.query_camera, pair->other_camera, is_calibrated);
  if (!E) return;
  const Rays other_rays = RaysOf(CameraOfGeometry(pair->other_camera, is_calibrated), pair->other_keypoints);
  Matches matches = method.MatchGuided(query, query_rays, database, other_rays, *E,
                                       MaxErrorRad(problem.query_camera, pair->other_camera));
  if (static_cast<int>(matches.size()) < kMinNumInliers) return;
  pair->matches = pair->geometry->inlier_matches = std::move(matches);
}

}  // namespace

void MatchPairs(const FeatureMethod& method, const Features& query_features,
                const std::vector<std::shared_ptr<const Features>>& database_features,
                const PairMatchingOptions& options, IdleThreads* idle_threads, LocalizationProblem* problem,
                StageTimer::Seconds* seconds) {
  std::vector<ImagePair>& pairs = problem->pairs;
  LAZYLOC_CHECK(database_features.size() == pairs.size());
  const bool is_guided = method.HasGuidedMatching() && !options.compares_all;
  {
    const StageTimer timer("matching", seconds);
    const Subset largest = is_guided ? LargestFeatures(query_features) : Subset();
    ParallelFor(
        pairs.size(),
        [&](size_t i) {
          const Features& features = *database_features[i];
          pairs[i].other_keypoints = Positions(features.keypoints);
          pairs[i].matches = is_guided
                                 ? MatchLargest(method, *problem, largest, pairs[i], features)
                                 : method.Match(query_features, problem->query_camera, features, pairs[i].other_camera);
        },
        idle_threads);
  }
  std::vector<size_t> num_matches;
  for (ImagePair& pair : pairs) {
    num_matches.push_back(pair.matches.size());
    pair.geometry.emplace().config = TwoViewConfig::DEGENERATE;
  }
  const bool verifies_all = !is_guided || options.max_num_verified == 0;
  const std::vector<size_t> verified =
      IndicesOfLargest(num_matches, verifies_all ? pairs.size() : static_cast<size_t>(options.max_num_verified));
  {
    const StageTimer timer("verification", seconds);
    ParallelFor(
        verified.size(),
        [&](size_t i) {
          ImagePair& pair = pairs[verified[i]];
          pair.geometry = Verify(*problem, pair, options.seed);
        },
        idle_threads);
  }
  if (!is_guided || !HasFurtherFeatures(method, *problem)) return;
  const StageTimer timer("matching", seconds);
  const Rays query_rays = RaysOf(CameraOfGeometry(problem->query_camera, IsCalibrated(problem->intrinsics_origin)),
                                 problem->query_keypoints);
  ParallelFor(
      verified.size(),
      [&](size_t i) {
        ImagePair& pair = pairs[verified[i]];
        if (pair.geometry->config == TwoViewConfig::DEGENERATE) return;
        MatchGuided(method, *problem, query_features, query_rays, *database_features[verified[i]], &pair);
      },
      idle_threads);
}

bool HasFurtherFeatures(const FeatureMethod& method, const LocalizationProblem& problem) {
  const auto has_further = [](const std::vector<Eigen::Vector2d>& keypoints) { return keypoints.size() > kNumLargest; };
  return method.HasGuidedMatching() &&
         (has_further(problem.query_keypoints) ||
          std::any_of(problem.pairs.begin(), problem.pairs.end(),
                      [&](const ImagePair& pair) { return has_further(pair.other_keypoints); }));
}

}  // namespace lazyloc

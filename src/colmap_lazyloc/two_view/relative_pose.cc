#include "colmap_lazyloc/two_view/relative_pose.h"

#include "colmap_lazyloc/bridge/two_view_geometry.h"

namespace lazyloc {
namespace {

// True if COLMAP may find a calibrated geometry in the matches, although the stored configuration gives no relative
// pose.
bool IsWorthEstimating(TwoViewConfig config) {
  return config == TwoViewConfig::MULTIPLE || config == TwoViewConfig::UNDEFINED;
}

TwoViewGeometry Estimate(const LocalizationProblem& problem, const ImagePair& pair, const Matches& matches,
                         uint32_t seed, bool is_query_calibrated = true) {
  return EstimateTwoViewGeometry(pair.other_camera, pair.other_keypoints, problem.query_camera, problem.query_keypoints,
                                 matches, is_query_calibrated, seed);
}

}  // namespace

std::optional<RelativePose> FindRelativePose(const LocalizationProblem& problem, const ImagePair& pair, uint32_t seed) {
  TwoViewGeometry geometry;
  if (!pair.geometry) {
    geometry = Estimate(problem, pair, pair.matches, seed);
  } else if (pair.geometry->config == TwoViewConfig::UNCALIBRATED) {
    geometry = EstimateCalibratedGeometry(pair.other_camera, pair.other_keypoints, problem.query_camera,
                                          problem.query_keypoints, *pair.geometry, seed);
  } else if (IsWorthEstimating(pair.geometry->config)) {
    const Matches& matches = pair.matches.empty() ? pair.geometry->inlier_matches : pair.matches;
    geometry = Estimate(problem, pair, matches, seed);
  } else {
    geometry = *pair.geometry;
    if (HoldsCalibrated(geometry.config) && !geometry.query_from_other) {
      EstimateRelativePose(pair.other_camera, pair.other_keypoints, problem.query_camera, problem.query_keypoints,
                           &geometry);
    }
  }
  if (!HoldsCalibrated(geometry.config) || !geometry.query_from_other ||
      static_cast<int>(geometry.inlier_matches.size()) < kMinNumInliers) {
    return std::nullopt;
  }
  if (geometry.config == TwoViewConfig::PANORAMIC) geometry.query_from_other->translation.setZero();
  return RelativePose{*geometry.query_from_other, std::move(geometry.inlier_matches)};
}

Matches FindInlierMatches(const LocalizationProblem& problem, const ImagePair& pair, uint32_t seed) {
  TwoViewGeometry geometry;
  if (pair.geometry) {
    geometry = *pair.geometry;
  } else {
    geometry = Estimate(problem, pair, pair.matches, seed, /*is_query_calibrated=*/false);
  }
  const bool is_usable = geometry.config != TwoViewConfig::DEGENERATE && geometry.config != TwoViewConfig::WATERMARK &&
                         static_cast<int>(geometry.inlier_matches.size()) >= kMinNumInliers;
  return is_usable ? std::move(geometry.inlier_matches) : Matches();
}

}  // namespace lazyloc

#include "colmap_lazyloc/two_view/relative_pose.h"

#include "colmap_lazyloc/bridge/two_view_estimation.h"
#include "colmap_lazyloc/scene/equirectangular.h"

namespace lazyloc {
namespace {

// True if a calibrated geometry may be found in the matches, although the stored one gives no relative pose.
bool IsWorthEstimating(const LocalizationProblem& problem, const ImagePair& pair) {
  const TwoViewConfig config = pair.geometry->config;
  if (config == TwoViewConfig::MULTIPLE || config == TwoViewConfig::UNDEFINED) return true;
  // Decompositions of stored matrices are for points in front of the image plane.
  const bool is_spherical = IsEquirectangular(problem.query_camera) || IsEquirectangular(pair.other_camera);
  return is_spherical && !pair.geometry->query_from_other && config != TwoViewConfig::DEGENERATE &&
         config != TwoViewConfig::WATERMARK;
}

}  // namespace

std::optional<RelativePose> FindRelativePose(const LocalizationProblem& problem, const ImagePair& pair, uint32_t seed) {
  TwoViewGeometry geometry;
  if (!pair.geometry) {
    geometry = EstimateTwoViewGeometry(problem, pair, pair.matches, /*is_query_calibrated=*/true, seed);
  } else if (IsWorthEstimating(problem, pair)) {
    const Matches& matches = pair.matches.empty() ? pair.geometry->inlier_matches : pair.matches;
    geometry = EstimateTwoViewGeometry(problem, pair, matches, /*is_query_calibrated=*/true, seed);
  } else if (pair.geometry->config == TwoViewConfig::UNCALIBRATED) {
    geometry = EstimateCalibratedGeometry(problem, pair, seed);
  } else {
    geometry = *pair.geometry;
    if (HoldsCalibrated(geometry.config) && !geometry.query_from_other) EstimateRelativePose(problem, pair, &geometry);
  }
  if (!HoldsCalibrated(geometry.config) || !geometry.query_from_other ||
      static_cast<int>(geometry.inlier_matches.size()) < kMinNumInliers) {
    return std::nullopt;
  }
  if (geometry.config == TwoViewConfig::PANORAMIC) geometry.query_from_other->translation.setZero();
  return RelativePose{*geometry.query_from_other, std::move(geometry.inlier_matches)};
}

Matches FindInlierMatches(const LocalizationProblem& problem, const ImagePair& pair, uint32_t seed) {
  TwoViewGeometry geometry =
      pair.geometry ? *pair.geometry
                    : EstimateTwoViewGeometry(problem, pair, pair.matches, /*is_query_calibrated=*/false, seed);
  const bool is_usable = geometry.config != TwoViewConfig::DEGENERATE && geometry.config != TwoViewConfig::WATERMARK &&
                         static_cast<int>(geometry.inlier_matches.size()) >= kMinNumInliers;
  return is_usable ? std::move(geometry.inlier_matches) : Matches();
}

}  // namespace lazyloc

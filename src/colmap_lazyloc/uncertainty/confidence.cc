#include "colmap_lazyloc/uncertainty/confidence.h"

#include <algorithm>
#include <cmath>

#include "colmap_lazyloc/scene/format.h"
#include "colmap_lazyloc/uncertainty/confidence_factors.h"

namespace lazyloc {
namespace {

// Bounds that keep the odds finite.
constexpr double kMinExplained = 1e-3, kMinNumPoints = 0.5;
// Weight of a point of a single database image, which confirms one coordinate of the pose's few.
constexpr double kSinglePointWeight = 0.1;
// Odds that remain with perfect evidence.
constexpr double kMinOdds = 1e-3;

double OddsOfAnotherPlace(const PoseEvidence& evidence) {
  if (std::isnan(evidence.explained_ratio)) return 0;
  const double explained = std::clamp(evidence.explained_ratio, kMinExplained, 1.0);
  return kPlaceOdds * std::pow(evidence.median_error_px * (1 - explained) / explained, 2);
}

double OddsOfChance(const PoseEvidence& evidence) {
  const double num_points = evidence.num_common_tracks + kSinglePointWeight * evidence.num_single_tracks;
  return std::pow(kChanceNumPoints / std::max(num_points, kMinNumPoints), 1.5);
}

}  // namespace

double OddsOfCompetingPose(const PoseEvidence& evidence) {
  return kCompetingOdds * std::pow(evidence.competing_ratio, 3);
}

double Confidence(const PoseEvidence& evidence) {
  if (!std::isfinite(evidence.position_stddev_ratio)) return 0;
  return 1 / (1 + kMinOdds + OddsOfAnotherPlace(evidence) + OddsOfCompetingPose(evidence) + OddsOfChance(evidence));
}

std::string LowConfidenceReason(const PoseEvidence& evidence, double confidence, double min_confidence) {
  const double place = OddsOfAnotherPlace(evidence), competing = OddsOfCompetingPose(evidence);
  const double chance = OddsOfChance(evidence);
  const std::string cause =
      chance > std::max(place, competing)
          ? Format("only %.0f points are seen by two or more other images", evidence.num_common_tracks)
      : competing > place ? Format("points that do not fit this pose agree on another one, with %.0f %% of its score",
                                   100 * evidence.competing_ratio)
                          : Format("the pose explains only %.0f %% of the verified matches, within %.1f px",
                                   100 * evidence.explained_ratio, evidence.median_error_px);
  return Format("the pose is right with a probability of only %.2f, and %.2f is needed: %s", confidence, min_confidence,
                cause.c_str());
}

}  // namespace lazyloc

#include "colmap_lazyloc/pipeline/confidence.h"

#include <algorithm>
#include <cmath>

#include "colmap_lazyloc/pipeline/confidence_weights.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

// Exponent that makes odds of a ratio of matches: a pose with twice the matches of its rival is eight times as
// probable.
constexpr double kRivalPower = 3;
// Ratio of the rival's matches from which it lowers the confidence more than any other evidence.
constexpr double kMinDecisiveRivalRatio = 0.2;

// Returns the odds that the rival is right instead of the pose.
double RivalOdds(const PoseEvidence& evidence) {
  if (std::isnan(evidence.rival_ratio)) return 0;
  const double ratio = std::min(evidence.rival_ratio, 0.99);
  return std::pow(ratio / (1 - ratio), kRivalPower);
}

// Returns how much the evidence of a term differs from that of a typical right pose, times its weight.
double Contribution(const ConfidenceTerm& term, const PoseEvidence& evidence) {
  const double value = evidence.*term.evidence;
  if (std::isnan(value)) return 0;
  const double clamped = std::clamp(value, term.min, term.max);
  return term.weight * (term.is_logarithmic ? std::log(clamped / term.typical) : clamped - term.typical);
}

std::string Describe(const ConfidenceTerm& term, const PoseEvidence& evidence) {
  const double value = evidence.*term.evidence;
  if (term.evidence == &PoseEvidence::num_common_tracks) {
    return Format("only %.0f points are seen by two or more other images", value);
  }
  if (term.evidence == &PoseEvidence::explained_ratio) {
    return Format("the pose explains only %.0f %% of the verified matches", 100 * value);
  }
  if (term.evidence == &PoseEvidence::agreeing_ratio) {
    return Format("pairs with only %.0f %% of the verified matches agree with the pose", 100 * value);
  }
  if (term.evidence == &PoseEvidence::median_error_px) {
    return Format("the points fit the query only within %.1f px (are the intrinsics right?)", value);
  }
  if (term.evidence == &PoseEvidence::mean_error_px) {
    return Format("some matches contradict the pose: the mean reprojection error is %.1f px", value);
  }
  if (term.evidence == &PoseEvidence::mean_track_length) {
    return Format("a point is seen by only %.1f images on average, the query among them", value);
  }
  if (term.evidence == &PoseEvidence::rotation_stddev_deg) {
    return Format("the rotation's standard deviation is %.2f degrees", value);
  }
  if (term.evidence == &PoseEvidence::rotation_position_ratio) {
    return Format("the position is %.0f times as uncertain as the rotation explains", 1 / value);
  }
  if (term.evidence == &PoseEvidence::focal_stddev_ratio) {
    return Format("the images fix the focal length only within %.1f %%", 100 * value);
  }
  return Format("refinement moved the position by %.1f %% of the distance to the points", 100 * value);
}

}  // namespace

double Confidence(const PoseEvidence& evidence) {
  if (!std::isfinite(evidence.position_stddev_ratio)) return 0;
  double log_odds = kTypicalLogOdds;
  for (const ConfidenceTerm& term : kConfidenceTerms) log_odds += Contribution(term, evidence);
  return 1 / (1 + std::exp(-log_odds) + RivalOdds(evidence));
}

std::string LowConfidenceReason(const PoseEvidence& evidence, double confidence, double min_confidence) {
  const auto weakest = std::min_element(kConfidenceTerms.begin(), kConfidenceTerms.end(),
                                        [&](const ConfidenceTerm& a, const ConfidenceTerm& b) {
                                          return Contribution(a, evidence) < Contribution(b, evidence);
                                        });
  const std::string cause = evidence.rival_ratio >= kMinDecisiveRivalRatio
                                ? Format("of the matches of pairs that agree on a pose, %.0f %% are for another one",
                                         100 * evidence.rival_ratio)
                                : Describe(*weakest, evidence);
  return Format("the pose is right with a probability of only %.2f, and %.2f is needed: %s", confidence, min_confidence,
                cause.c_str());
}

void RequireConfidence(double min_confidence, LocalizationResult* result) {
  if (!result->confidence || *result->confidence >= min_confidence) return;
  result->status = QueryStatus::LOW_CONFIDENCE;
  result->reason = LowConfidenceReason(result->evidence, *result->confidence, min_confidence);
}

}  // namespace lazyloc

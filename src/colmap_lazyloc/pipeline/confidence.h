#pragma once

#include <string>

#include "colmap_lazyloc/scene/localization_result.h"
#include "colmap_lazyloc/scene/pose_evidence.h"

namespace lazyloc {

// Distance, over the median distance of the points, that a right position may be off beside three of its standard
// deviations: smaller errors hardly matter, and ground truth is seldom better.
inline constexpr double kMaxRightErrorFloor = 0.01;

// Returns the probability that the position is off by at most three of its standard deviations plus kMaxRightErrorFloor
// times the median distance of the points. The odds of a wrong pose are the sum of those by a weighted sum of the
// evidence and those by the rival. The weights (confidence_weights.h) are fitted to positions with known errors.
// Evidence that is unknown counts as that of a typical right pose. Returns 0 if the position's standard deviation is
// not finite.
double Confidence(const PoseEvidence& evidence);

// Returns one sentence that names what lowers the confidence most.
std::string LowConfidenceReason(const PoseEvidence& evidence, double confidence, double min_confidence);

// Gives a result with a pose whose confidence is below min_confidence the status LOW_CONFIDENCE.
void RequireConfidence(double min_confidence, LocalizationResult* result);

}  // namespace lazyloc

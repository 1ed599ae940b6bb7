#pragma once

#include <string>

#include "colmap_lazyloc/scene/localization_result.h"
#include "colmap_lazyloc/scene/pose_evidence.h"

namespace lazyloc {

// Returns the probability that the position is right: off by at most 5 of its standard deviations and by at most 1 % of
// the scene's size, as leave_one_out.json counts. The odds of a wrong pose are the sum of those by a weighted sum of
// the evidence and those by the rival. The weights (confidence_weights.h) are fitted to positions with known errors.
// Evidence that is unknown counts as that of a typical right pose; only if no pair can agree, because the focal length
// is estimated, the odds fall. Returns 0 if the position's standard deviation is not finite.
double Confidence(const PoseEvidence& evidence);

// Returns one sentence that names what lowers the confidence most.
std::string LowConfidenceReason(const PoseEvidence& evidence, double confidence, double min_confidence);

// Gives a result with a pose whose confidence is below min_confidence the status LOW_CONFIDENCE.
void RequireConfidence(double min_confidence, LocalizationResult* result);

}  // namespace lazyloc

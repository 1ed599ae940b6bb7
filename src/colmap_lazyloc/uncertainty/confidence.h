#pragma once

#include <string>

#include "colmap_lazyloc/scene/pose_evidence.h"

namespace lazyloc {

// Returns the probability that the position is not wrong: the posterior of the pose against three other explanations of
// the matches. The covariance says how far a right position may be off.
//
//  another place  All matches that the pose does not explain speak for one other place that looks alike. Matches of one
//                 surface are not independent, so the odds are not exponential in their number: they are the square
//                 of the ratio of the matches against to those for the pose, times the area of the image that the error
//                 of its points covers.
//  a competing    Points that do not fit the pose agree with each other on another one. The odds are the third power of
//  pose           the ratio of the scores of both.
//  chance         A few points fit any pose. The odds fall with the number of points that two or more other images see,
//                 or whose depth is known, and a tenth of the others, to the power of 1.5.
//
// The factors are fitted to positions with known errors (docs/method.md). Returns 0 if the position's standard
// deviation is not finite.
double Confidence(const PoseEvidence& evidence);

// Returns the odds that a pose with this confidence is wrong.
inline double OddsOfWrong(double confidence) { return 1 / confidence - 1; }

// Returns the odds of the competing pose over the pose; 0 without any.
double OddsOfCompetingPose(const PoseEvidence& evidence);

// Returns one sentence that names what lowers the confidence most.
std::string LowConfidenceReason(const PoseEvidence& evidence, double confidence, double min_confidence);

}  // namespace lazyloc

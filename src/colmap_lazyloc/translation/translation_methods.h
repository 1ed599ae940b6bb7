#pragma once

#include "colmap_lazyloc/translation/translation_averaging.h"

namespace lazyloc {

inline constexpr int kMaxNumTranslationIterations = 50;  // far more than a solve takes

// Methods of AverageTranslations, each in its own file. They change the centres of known nodes that are not fixed,
// starting from result->cams_in_world, and set result->summary.

void AverageByAngles(const TranslationAveragingProblem& problem, TranslationAveragingResult* result);
void AverageByLeastUnsquaredDeviations(const TranslationAveragingProblem& problem, TranslationAveragingResult* result);

// Returns the vector from the first to the second image of an edge.
inline Eigen::Vector3d Baseline(const DirectionEdge& edge, const std::vector<Eigen::Vector3d>& centres) {
  return centres[edge.node2] - centres[edge.node1] + edge.offset_in_world;
}

// Returns the noise of an edge, with that of errors that the rays do not show.
double EdgeStddevRad(const DirectionEdge& edge);

}  // namespace lazyloc

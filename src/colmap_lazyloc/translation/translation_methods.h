#pragma once

#include "colmap_lazyloc/translation/translation_averaging.h"

namespace lazyloc {

// Methods of AverageTranslations, each in its own file. They change the centres of known nodes that are not fixed,
// starting from result->cams_in_world, and set result->summary.

void AverageByAngles(const TranslationAveragingProblem& problem, const TranslationAveragingOptions& options,
                     TranslationAveragingResult* result);
void AverageByLeastUnsquaredDeviations(const TranslationAveragingProblem& problem,
                                       const TranslationAveragingOptions& options, TranslationAveragingResult* result);

// Returns the vector from the first to the second image of an edge.
inline Eigen::Vector3d Baseline(const DirectionEdge& edge, const std::vector<Eigen::Vector3d>& centres) {
  return centres[edge.node2] - centres[edge.node1] + edge.offset_in_world;
}

// Returns the noise of an edge, with min_direction_stddev_deg added in quadrature.
double EdgeStddevRad(const DirectionEdge& edge, const TranslationAveragingOptions& options);

}  // namespace lazyloc

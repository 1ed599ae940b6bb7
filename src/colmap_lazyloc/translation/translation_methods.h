#pragma once

#include "colmap_lazyloc/translation/translation_averaging.h"

namespace lazyloc {

// The methods of AverageTranslations, each in a file of its own: they move the known nodes that are not fixed from
// their start and fill the summary.

void AverageByAngles(const TranslationAveragingProblem& problem, const TranslationAveragingOptions& options,
                     TranslationAveragingResult* result);
void AverageByLeastUnsquaredDeviations(const TranslationAveragingProblem& problem,
                                       const TranslationAveragingOptions& options, TranslationAveragingResult* result);

// Between the images of an edge.
inline Eigen::Vector3d Baseline(const DirectionEdge& edge, const std::vector<Eigen::Vector3d>& centres) {
  return centres[edge.node2] - centres[edge.node1] + edge.offset_in_world;
}

// An edge's own noise with the floor of the options.
double EdgeStddevRad(const DirectionEdge& edge, const TranslationAveragingOptions& options);

}  // namespace lazyloc

#pragma once

#include "colmap_lazyloc/translation/translation_averaging.h"

namespace lazyloc {

// The methods of AverageTranslations, each in a file of its own: they move the known nodes that are not fixed from
// their start and fill the summary.

void AverageByAngles(const TranslationAveragingProblem& problem, const TranslationAveragingOptions& options,
                     TranslationAveragingResult* result);
void AverageByLeastUnsquaredDeviations(const TranslationAveragingProblem& problem,
                                       const TranslationAveragingOptions& options, TranslationAveragingResult* result);

// An edge's own noise with the floor of the options.
double EdgeStddevRad(const DirectionEdge& edge, const TranslationAveragingOptions& options);

}  // namespace lazyloc

#pragma once

#include "colmap_lazyloc/rotation/rotation_averaging.h"
#include "colmap_lazyloc/translation/translation_averaging.h"

namespace lazyloc {

// A RotationAverager. Sets each unknown node in turn to the mean of its neighbours' proposals, until no node moves: the
// minimum of the squared chords. Not robust: a single wrong edge changes the result.
void AverageByQuaternionMean(const RotationAveragingProblem& problem, RotationAveragingResult* result);

// A TranslationAverager. Least unsquared deviations (LUD): minimises sum |b - lambda dir| over the centres and lambda
// >= 0, b = C2 - C1 + offset. Convex; solved by reweighted least squares; all edges have the same weight. Ozyesil &
// Singer, Robust Camera Location Estimation by Convex Programming, CVPR 2015. Their lambda >= 1 fixes the scale; here
// lambda >= 0 is enough, because the fixed centres determine the scale.
void AverageByLeastUnsquaredDeviations(const TranslationAveragingProblem& problem, TranslationAveragingResult* result);

}  // namespace lazyloc

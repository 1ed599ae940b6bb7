#pragma once

#include "colmap_lazyloc/rotation/rotation_averaging.h"

namespace lazyloc {

// The methods of AverageRotations, each in a file of its own: they move the known nodes that are not fixed from their
// start and count the iterations.

void AverageByL1Irls(const RotationAveragingProblem& problem, const RotationAveragingOptions& options,
                     RotationAveragingResult* result);
void AverageByL1(const RotationAveragingProblem& problem, const RotationAveragingOptions& options,
                 RotationAveragingResult* result);
void AverageByQuaternionMean(const RotationAveragingProblem& problem, const RotationAveragingOptions& options,
                             RotationAveragingResult* result);

}  // namespace lazyloc

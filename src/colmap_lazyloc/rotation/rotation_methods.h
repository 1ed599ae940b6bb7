#pragma once

#include "colmap_lazyloc/rotation/rotation_averaging.h"

namespace lazyloc {

// Methods of AverageRotations, each in its own file. They change the rotations of known nodes that are not fixed,
// starting from result->rotations, and set result->summary.iterations.

void AverageByL1Irls(const RotationAveragingProblem& problem, const RotationAveragingOptions& options,
                     RotationAveragingResult* result);
void AverageByL1(const RotationAveragingProblem& problem, const RotationAveragingOptions& options,
                 RotationAveragingResult* result);
void AverageByQuaternionMean(const RotationAveragingProblem& problem, const RotationAveragingOptions& options,
                             RotationAveragingResult* result);

}  // namespace lazyloc

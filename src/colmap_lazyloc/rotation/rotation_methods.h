#pragma once

#include "colmap_lazyloc/rotation/rotation_averaging.h"

namespace lazyloc {

// Iterations end when no rotation changes by more: far below any measurement's noise, because an iteration is cheap.
inline constexpr double kRotationConvergenceDeg = 1e-10;

// Methods of AverageRotations, each in its own file. They change the rotations of known nodes that are not fixed,
// starting from result->rotations, and set result->summary.iterations.

void AverageByL1Irls(const RotationAveragingProblem& problem, RotationAveragingResult* result);
void AverageByL1(const RotationAveragingProblem& problem, RotationAveragingResult* result);
void AverageByQuaternionMean(const RotationAveragingProblem& problem, RotationAveragingResult* result);

}  // namespace lazyloc

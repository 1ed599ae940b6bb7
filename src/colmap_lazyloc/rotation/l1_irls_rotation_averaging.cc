#include "colmap_lazyloc/math/robust_weights.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/rotation/reweighted_solver.h"
#include "colmap_lazyloc/rotation/rotation_methods.h"

namespace lazyloc {

// Runs L1 steps before IRLS, because the redescending loss needs a start in the basin of its global minimum. Chatterjee
// & Govindu, algorithm 1.
void AverageByL1Irls(const RotationAveragingProblem& problem, RotationAveragingResult* result) {
  AverageByL1(problem, result);
  constexpr int kNumIterations = 20;
  // Take twice the error of a good pair as the loss's scale, so that a pair that is off by 5 deg hardly counts.
  constexpr double kScaleDeg = 2;
  const double scale_rad = DegToRad(kScaleDeg);
  ReweightedSolver(problem, result).Iterate(kNumIterations, DegToRad(kRotationConvergenceDeg), [=](double error) {
    return GemanMcClureWeight(error * error, scale_rad);
  });
}

}  // namespace lazyloc

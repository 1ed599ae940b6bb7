#include "colmap_lazyloc/math/robust_weights.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/rotation/reweighted_solver.h"
#include "colmap_lazyloc/rotation/rotation_methods.h"

namespace lazyloc {

// Minimises the L1 norm of the edges' errors, because outliers change its minimum only slightly.
void AverageByL1(const RotationAveragingProblem& problem, RotationAveragingResult* result) {
  constexpr int kNumIterations = 10;  // enough for the basin of the next, redescending cost
  const double floor_rad = DegToRad(0.1);
  ReweightedSolver(problem, result).Iterate(kNumIterations, DegToRad(kRotationConvergenceDeg), [=](double error) {
    return L1Weight(error, floor_rad);
  });
}

}  // namespace lazyloc

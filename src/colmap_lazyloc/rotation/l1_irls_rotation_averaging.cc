#include "colmap_lazyloc/math/robust_weights.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/rotation/reweighted_solver.h"
#include "colmap_lazyloc/rotation/rotation_methods.h"

namespace lazyloc {

// Runs L1 steps before IRLS, because the redescending loss needs a start in the basin of its global minimum. Chatterjee
// & Govindu, algorithm 1.
void AverageByL1Irls(const RotationAveragingProblem& problem, const RotationAveragingOptions& options,
                     RotationAveragingResult* result) {
  AverageByL1(problem, options, result);
  const double scale_rad = DegToRad(options.irls_scale_deg);
  ReweightedSolver(problem, result)
      .Iterate(options.num_irls_iterations, DegToRad(options.convergence_deg),
               [=](double error) { return GemanMcClureWeight(error * error, scale_rad); });
}

}  // namespace lazyloc

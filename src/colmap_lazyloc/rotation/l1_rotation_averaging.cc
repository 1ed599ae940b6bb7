#include "colmap_lazyloc/math/robust_weights.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/rotation/reweighted_solver.h"
#include "colmap_lazyloc/rotation/rotation_methods.h"

namespace lazyloc {

// Minimises the L1 norm of the edges' errors, because outliers change its minimum only slightly.
void AverageByL1(const RotationAveragingProblem& problem, const RotationAveragingOptions& options,
                 RotationAveragingResult* result) {
  const double floor_rad = DegToRad(0.1);
  ReweightedSolver(problem, result)
      .Iterate(options.num_l1_iterations, DegToRad(options.convergence_deg),
               [=](double error) { return L1Weight(error, floor_rad); });
}

}  // namespace lazyloc

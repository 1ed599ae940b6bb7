#include <algorithm>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/rotation/rotation_methods.h"
#include "colmap_lazyloc/rotation/rotation_proposals.h"

namespace lazyloc {

// Each node becomes the mean of what its neighbours propose. One unknown node is done at once; several take turns, each
// turn lowering the weighted sum of all edges' squared chords, until none moves.
void AverageByQuaternionMean(const RotationAveragingProblem& problem, const RotationAveragingOptions& options,
                             RotationAveragingResult* result) {
  constexpr int kMaxNumSweeps = 100;
  double largest_move_rad = 1;
  while (result->summary.iterations < kMaxNumSweeps && largest_move_rad > DegToRad(options.convergence_deg)) {
    ++result->summary.iterations;
    largest_move_rad = 0;
    for (int node = 0; node < static_cast<int>(problem.is_fixed.size()); ++node) {
      if (problem.is_fixed[node] || !result->is_known[node]) continue;
      const Eigen::Quaterniond mean = MeanRotation(ProposalsFor(node, problem, *result));
      largest_move_rad = std::max(largest_move_rad, AngularDistanceRad(result->rotations[node], mean));
      result->rotations[node] = mean;
    }
  }
}

}  // namespace lazyloc

#include <algorithm>

#include "averaging_methods.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/rotation/rotation_methods.h"

namespace lazyloc {

// Sets each unknown node in turn to the mean of its neighbours' proposals, until no node moves. Each step decreases the
// weighted sum of all edges' squared chords. A single unknown node needs only one step.
void AverageByQuaternionMean(const RotationAveragingProblem& problem, RotationAveragingResult* result) {
  constexpr int kMaxNumSweeps = 100;
  const std::vector<std::vector<size_t>> edges_of = EdgesByNode(problem);
  double largest_move_rad = 1;
  for (int sweep = 0; sweep < kMaxNumSweeps && largest_move_rad > DegToRad(kRotationConvergenceDeg); ++sweep) {
    largest_move_rad = 0;
    for (int node = 0; node < static_cast<int>(problem.is_fixed.size()); ++node) {
      if (problem.is_fixed[node] || !result->is_known[node]) continue;
      const Eigen::Quaterniond mean = MeanRotation(ProposalsFor(node, edges_of[node], problem, *result));
      largest_move_rad = std::max(largest_move_rad, AngularDistanceRad(result->rotations[node], mean));
      result->rotations[node] = mean;
    }
  }
}

}  // namespace lazyloc

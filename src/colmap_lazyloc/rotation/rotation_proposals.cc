#include "colmap_lazyloc/rotation/rotation_proposals.h"

#include <algorithm>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

double Support(const WeightedRotation& proposal, const std::vector<WeightedRotation>& all, double max_error_rad) {
  double support = 0;
  for (const WeightedRotation& other : all) {
    const double error = AngularDistanceRad(proposal.rotation, other.rotation);
    support += other.weight * std::max(0.0, 1 - error / max_error_rad);
  }
  return support;
}

}  // namespace

std::vector<WeightedRotation> ProposalsFor(int node, const RotationAveragingProblem& problem,
                                           const RotationAveragingResult& result) {
  std::vector<WeightedRotation> proposals;
  for (const RotationEdge& edge : problem.edges) {
    if (edge.node2 == node && result.is_known[edge.node1]) {
      proposals.push_back({edge.node2_from_node1 * result.rotations[edge.node1], edge.weight});
    } else if (edge.node1 == node && result.is_known[edge.node2]) {
      proposals.push_back({edge.node2_from_node1.conjugate() * result.rotations[edge.node2], edge.weight});
    }
  }
  return proposals;
}

void StartFromVotes(const RotationAveragingProblem& problem, double max_error_rad, RotationAveragingResult* result) {
  while (true) {
    int best_node = -1;
    double best_support = 0;
    Eigen::Quaterniond best_rotation;
    for (int node = 0; node < static_cast<int>(problem.is_fixed.size()); ++node) {
      if (result->is_known[node]) continue;
      const std::vector<WeightedRotation> proposals = ProposalsFor(node, problem, *result);
      for (const WeightedRotation& proposal : proposals) {
        const double support = Support(proposal, proposals, max_error_rad);
        if (support > best_support) {
          best_node = node;
          best_support = support;
          best_rotation = proposal.rotation;
        }
      }
    }
    if (best_node < 0) return;
    result->rotations[best_node] = best_rotation.normalized();
    result->is_known[best_node] = true;
  }
}

}  // namespace lazyloc

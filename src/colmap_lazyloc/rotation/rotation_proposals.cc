#include "colmap_lazyloc/rotation/rotation_proposals.h"

#include <algorithm>

#include "colmap_lazyloc/math/so3.h"

namespace lazyloc {
namespace {

// Returns the weight of all proposals near one of them, falling linearly to zero at kMaxRotationErrorDeg.
double Support(const WeightedRotation& proposal, const std::vector<WeightedRotation>& all) {
  double support = 0;
  for (const WeightedRotation& other : all) {
    const double error = AngularDistanceRad(proposal.rotation, other.rotation);
    support += other.weight * std::max(0.0, 1 - error / DegToRad(kMaxRotationErrorDeg));
  }
  return support;
}

}  // namespace

std::vector<std::vector<size_t>> EdgesByNode(const RotationAveragingProblem& problem) {
  std::vector<std::vector<size_t>> edges_of(problem.is_fixed.size());
  for (size_t i = 0; i < problem.edges.size(); ++i) {
    edges_of[problem.edges[i].node1].push_back(i);
    edges_of[problem.edges[i].node2].push_back(i);
  }
  return edges_of;
}

std::vector<WeightedRotation> ProposalsFor(int node, const std::vector<size_t>& edges,
                                           const RotationAveragingProblem& problem,
                                           const RotationAveragingResult& result) {
  std::vector<WeightedRotation> proposals;
  for (const size_t i : edges) {
    const RotationEdge& edge = problem.edges[i];
    if (edge.node2 == node && result.is_known[edge.node1]) {
      proposals.push_back({edge.node2_from_node1 * result.rotations[edge.node1], edge.weight});
    } else if (edge.node1 == node && result.is_known[edge.node2]) {
      proposals.push_back({edge.node2_from_node1.conjugate() * result.rotations[edge.node2], edge.weight});
    }
  }
  return proposals;
}

void StartFromVotes(const RotationAveragingProblem& problem, RotationAveragingResult* result) {
  const std::vector<std::vector<size_t>> edges_of = EdgesByNode(problem);
  std::vector<WeightedRotation> best_of(problem.is_fixed.size());  // best proposal of each node; weight: its support
  const auto vote = [&](size_t node) {
    best_of[node].weight = 0;
    if (result->is_known[node]) return;
    const std::vector<WeightedRotation> proposals =
        ProposalsFor(static_cast<int>(node), edges_of[node], problem, *result);
    for (const WeightedRotation& proposal : proposals) {
      const double support = Support(proposal, proposals);
      if (support > best_of[node].weight) best_of[node] = {proposal.rotation, support};
    }
  };
  for (size_t node = 0; node < best_of.size(); ++node) vote(node);
  while (true) {
    const auto best = std::max_element(best_of.begin(), best_of.end(),
                                       [](const auto& a, const auto& b) { return a.weight < b.weight; });
    if (best == best_of.end() || best->weight == 0) return;
    const size_t node = best - best_of.begin();
    result->rotations[node] = best->rotation.normalized();
    result->is_known[node] = true;
    vote(node);
    // Votes again for its neighbours only, because no other node has a new proposal.
    for (const size_t edge : edges_of[node]) vote(problem.edges[edge].node1 + problem.edges[edge].node2 - node);
  }
}

}  // namespace lazyloc

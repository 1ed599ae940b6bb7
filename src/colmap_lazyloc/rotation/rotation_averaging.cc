#include "colmap_lazyloc/rotation/rotation_averaging.h"

#include <algorithm>
#include <limits>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/rotation/rotation_methods.h"
#include "colmap_lazyloc/scene/errors.h"

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

// Sets start rotations of all nodes that are connected to a known one. Adds one node after another, always the one
// whose best proposal has the largest support. The support is the weight of all proposals of the node near that
// proposal; the weight falls linearly to zero at kMaxRotationErrorDeg.
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

Eigen::Vector3d EdgeErrorInWorld(const RotationEdge& edge, const std::vector<Eigen::Quaterniond>& rotations) {
  const Eigen::Quaterniond world_from_node2_measured =
      rotations[edge.node1].conjugate() * edge.node2_from_node1.conjugate();
  return LogSO3(world_from_node2_measured * rotations[edge.node2]);
}

RotationAveragingResult AverageRotations(const RotationAveragingProblem& problem, RotationAverager average) {
  LAZYLOC_CHECK(problem.rotations.size() == problem.is_fixed.size());
  RotationAveragingResult result;
  result.rotations = problem.rotations;
  result.is_known = problem.is_fixed;
  result.edge_errors_rad.assign(problem.edges.size(), std::numeric_limits<double>::quiet_NaN());
  const auto is_finite = [](const RotationEdge& edge) { return edge.node2_from_node1.coeffs().allFinite(); };
  if (!std::all_of(problem.edges.begin(), problem.edges.end(), is_finite)) {
    result.summary.message = "a relative rotation is not finite";
    return result;
  }
  StartFromVotes(problem, &result);
  if (result.is_known == problem.is_fixed) {
    result.summary.message = "no unknown rotation is linked to a fixed one";
    return result;
  }
  average(problem, &result);
  for (size_t i = 0; i < problem.edges.size(); ++i) {
    const RotationEdge& edge = problem.edges[i];
    if (!result.is_known[edge.node1] || !result.is_known[edge.node2]) continue;
    result.edge_errors_rad[i] = EdgeErrorInWorld(edge, result.rotations).norm();
  }
  result.summary.success = true;
  result.summary.message = "averaged";
  return result;
}

}  // namespace lazyloc

#include "colmap_lazyloc/translation/translation_averaging.h"

#include <algorithm>
#include <cmath>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/math/two_rays.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/translation/translation_methods.h"

namespace lazyloc {
namespace {

// Maximum angle between a start position and the direction of an edge that supports it.
constexpr double kMaxVoteErrorDeg = 10;
// Noise that is added in quadrature to that of each direction, for errors that the rays do not show (intrinsics,
// database poses).
constexpr double kMinDirectionStddevDeg = 0.1;

// Ray on which an edge places an unknown node: from a known centre along a direction.
struct Vote {
  Ray ray;
  double weight;
};

// Returns one vote per edge (indices `edges`) whose other node is known.
std::vector<Vote> VotesFor(int node, const std::vector<size_t>& edges, const TranslationAveragingProblem& problem,
                           const TranslationAveragingResult& result) {
  std::vector<Vote> votes;
  for (const size_t i : edges) {
    const DirectionEdge& edge = problem.edges[i];
    const double weight = 1 / EdgeStddevRad(edge);
    if (edge.node2 == node && result.is_known[edge.node1]) {
      votes.push_back({{result.cams_in_world[edge.node1] - edge.offset_in_world, edge.dir_1to2_in_world}, weight});
    } else if (edge.node1 == node && result.is_known[edge.node2]) {
      votes.push_back({{result.cams_in_world[edge.node2] + edge.offset_in_world, -edge.dir_1to2_in_world}, weight});
    }
  }
  return votes;
}

// Returns the weight of the rays near the point, falling linearly to zero at max_error_rad.
double Support(const Eigen::Vector3d& point, const std::vector<Vote>& votes, double max_error_rad) {
  double support = 0;
  for (const Vote& vote : votes) {
    const double error = AngleBetweenRad(point - vote.ray.origin, vote.ray.dir);
    support += vote.weight * std::max(0.0, 1 - error / max_error_rad);
  }
  return support;
}

struct Start {
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  double support = 0;
};

// Returns the crossing of two rays with the largest support. If no two rays cross, returns a point on the ray with the
// largest weight, at a distance of the largest distance between its origin and another.
Start BestStart(const std::vector<Vote>& votes) {
  const double max_error_rad = DegToRad(kMaxVoteErrorDeg);
  Start best;
  for (size_t a = 0; a < votes.size(); ++a) {
    for (size_t b = 0; b < a; ++b) {
      const std::optional<Eigen::Vector3d> point = Crossing(votes[a].ray, votes[b].ray);
      if (!point) continue;
      const double support = Support(*point, votes, max_error_rad);
      if (support > best.support) best = {*point, support};
    }
  }
  if (best.support > 0 || votes.empty()) return best;
  const Vote& strongest =
      *std::max_element(votes.begin(), votes.end(), [](const Vote& a, const Vote& b) { return a.weight < b.weight; });
  double extent = 0;
  for (const Vote& vote : votes) extent = std::max(extent, (vote.ray.origin - strongest.ray.origin).norm());
  best.point = strongest.ray.origin + (extent > 0 ? extent : 1) * strongest.ray.dir;
  best.support = strongest.weight;
  return best;
}

// Sets start positions of all nodes that are connected to a known one. Adds one node after another, always the one with
// the largest support.
void StartFromVotes(const TranslationAveragingProblem& problem, TranslationAveragingResult* result) {
  std::vector<std::vector<size_t>> edges_of(problem.is_fixed.size());
  for (size_t i = 0; i < problem.edges.size(); ++i) {
    edges_of[problem.edges[i].node1].push_back(i);
    edges_of[problem.edges[i].node2].push_back(i);
  }
  std::vector<Start> best_of(problem.is_fixed.size());
  const auto vote = [&](size_t node) {
    best_of[node] = Start();
    if (result->is_known[node]) return;
    best_of[node] = BestStart(VotesFor(static_cast<int>(node), edges_of[node], problem, *result));
  };
  for (size_t node = 0; node < best_of.size(); ++node) vote(node);
  while (true) {
    const auto best = std::max_element(best_of.begin(), best_of.end(),
                                       [](const Start& a, const Start& b) { return a.support < b.support; });
    if (best == best_of.end() || !(best->support > 0)) return;
    const size_t node = best - best_of.begin();
    result->cams_in_world[node] = best->point;
    result->is_known[node] = true;
    vote(node);
    // Votes again for its neighbours only, because no other node has a new vote.
    for (const size_t edge : edges_of[node]) vote(problem.edges[edge].node1 + problem.edges[edge].node2 - node);
  }
}

}  // namespace

double EdgeStddevRad(const DirectionEdge& edge) {
  return std::hypot(edge.stddev_rad, DegToRad(kMinDirectionStddevDeg));
}

TranslationAveragingResult AverageTranslations(const TranslationAveragingProblem& problem,
                                               TranslationAverager average) {
  LAZYLOC_CHECK(problem.cams_in_world.size() == problem.is_fixed.size());
  TranslationAveragingResult result;
  result.cams_in_world = problem.cams_in_world;
  result.is_known = problem.is_fixed;
  const auto is_finite = [](const DirectionEdge& edge) { return edge.dir_1to2_in_world.allFinite(); };
  if (!std::all_of(problem.edges.begin(), problem.edges.end(), is_finite)) {
    result.summary.message = "a direction is not finite";
    return result;
  }
  StartFromVotes(problem, &result);
  if (result.is_known == problem.is_fixed) {
    result.summary.message = "no unknown position is linked to a fixed one";
    return result;
  }
  average(problem, &result);
  return result;
}

}  // namespace lazyloc

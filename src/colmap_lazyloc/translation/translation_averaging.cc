#include "colmap_lazyloc/translation/translation_averaging.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/options_check.h"
#include "colmap_lazyloc/translation/translation_methods.h"

namespace lazyloc {
namespace {

// The line on which an edge puts an unknown node: from a known centre along a direction.
struct Ray {
  Eigen::Vector3d origin;
  Eigen::Vector3d dir;
  double weight;
};

std::vector<Ray> RaysTo(int node, const TranslationAveragingProblem& problem,
                        const TranslationAveragingOptions& options, const TranslationAveragingResult& result) {
  std::vector<Ray> rays;
  for (const DirectionEdge& edge : problem.edges) {
    const double weight = 1 / EdgeStddevRad(edge, options);
    if (edge.node2 == node && result.is_known[edge.node1]) {
      rays.push_back({result.cams_in_world[edge.node1] - edge.offset_in_world, edge.dir_1to2_in_world, weight});
    } else if (edge.node1 == node && result.is_known[edge.node2]) {
      rays.push_back({result.cams_in_world[edge.node2] + edge.offset_in_world, -edge.dir_1to2_in_world, weight});
    }
  }
  return rays;
}

// Midpoint of two rays' closest approach; false where they run parallel or meet behind an origin.
bool Crossing(const Ray& a, const Ray& b, double min_angle_rad, Eigen::Vector3d* point) {
  const Eigen::Vector3d normal = a.dir.cross(b.dir);
  const double squared_sine = normal.squaredNorm();
  if (squared_sine < std::pow(std::sin(min_angle_rad), 2)) return false;
  const Eigen::Vector3d baseline = b.origin - a.origin;
  const double along_a = baseline.cross(b.dir).dot(normal) / squared_sine;
  const double along_b = baseline.cross(a.dir).dot(normal) / squared_sine;
  if (along_a <= 0 || along_b <= 0) return false;
  *point = (a.origin + along_a * a.dir + b.origin + along_b * b.dir) / 2;
  return true;
}

double Support(const Eigen::Vector3d& point, const std::vector<Ray>& rays, double max_error_rad) {
  double support = 0;
  for (const Ray& ray : rays) {
    const double error = AngleBetweenRad(point - ray.origin, ray.dir);
    support += ray.weight * std::max(0.0, 1 - error / max_error_rad);
  }
  return support;
}

struct Start {
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  double support = 0;
  bool is_determined = false;
};

// The best supported crossing of two rays; where none cross, a point on the best ray, as far as the centres are apart.
Start BestStart(const std::vector<Ray>& rays, const TranslationAveragingOptions& options) {
  const double max_error_rad = DegToRad(options.max_vote_error_deg);
  Start best;
  for (size_t a = 0; a < rays.size(); ++a) {
    for (size_t b = 0; b < a; ++b) {
      Eigen::Vector3d point;
      if (!Crossing(rays[a], rays[b], DegToRad(options.min_ray_angle_deg), &point)) continue;
      const double support = Support(point, rays, max_error_rad);
      if (support > best.support) best = {point, support, true};
    }
  }
  if (best.is_determined || rays.empty()) return best;
  const Ray& strongest =
      *std::max_element(rays.begin(), rays.end(), [](const Ray& a, const Ray& b) { return a.weight < b.weight; });
  double extent = 0;
  for (const Ray& ray : rays) extent = std::max(extent, (ray.origin - strongest.origin).norm());
  best.point = strongest.origin + (extent > 0 ? extent : 1) * strongest.dir;
  best.support = strongest.weight;
  return best;
}

void StartFromVotes(const TranslationAveragingProblem& problem, const TranslationAveragingOptions& options,
                    TranslationAveragingResult* result) {
  while (true) {
    int best_node = -1;
    Start best;
    for (int node = 0; node < static_cast<int>(problem.is_fixed.size()); ++node) {
      if (result->is_known[node]) continue;
      const Start start = BestStart(RaysTo(node, problem, options, *result), options);
      if (start.support > best.support) {
        best = start;
        best_node = node;
      }
    }
    if (best_node < 0) return;
    result->cams_in_world[best_node] = best.point;
    result->is_known[best_node] = true;
    result->is_determined[best_node] = best.is_determined;
  }
}

void AverageBy(TranslationAveragingMethod method, const TranslationAveragingProblem& problem,
               const TranslationAveragingOptions& options, TranslationAveragingResult* result) {
  switch (method) {
    case TranslationAveragingMethod::ANGULAR: return AverageByAngles(problem, options, result);
    case TranslationAveragingMethod::LUD: return AverageByLeastUnsquaredDeviations(problem, options, result);
  }
}

}  // namespace

double EdgeStddevRad(const DirectionEdge& edge, const TranslationAveragingOptions& options) {
  return std::hypot(edge.stddev_rad, DegToRad(options.min_direction_stddev_deg));
}

bool TranslationAveragingOptions::Check(std::string* error) const {
  OPTION_GT(min_direction_stddev_deg, 0);
  OPTION_GT(loss_scale_sigma, 0);
  OPTION_GT(max_vote_error_deg, 0);
  OPTION_GT(min_ray_angle_deg, 0);
  OPTION_GE(max_num_iterations, 0);
  return true;
}

TranslationAveragingResult AverageTranslations(const TranslationAveragingProblem& problem,
                                               const TranslationAveragingOptions& options) {
  LAZYLOC_CHECK(problem.cams_in_world.size() == problem.is_fixed.size());
  TranslationAveragingResult result;
  result.cams_in_world = problem.cams_in_world;
  result.is_known = result.is_determined = problem.is_fixed;
  result.edge_errors_rad.assign(problem.edges.size(), std::numeric_limits<double>::quiet_NaN());
  const auto is_finite = [](const DirectionEdge& edge) { return edge.dir_1to2_in_world.allFinite(); };
  if (!std::all_of(problem.edges.begin(), problem.edges.end(), is_finite)) {
    result.summary.message = "a direction is not finite";
    return result;
  }
  StartFromVotes(problem, options, &result);
  if (result.is_known == problem.is_fixed) {
    result.summary.message = "no unknown position is linked to a fixed one";
    return result;
  }
  AverageBy(options.method, problem, options, &result);
  for (size_t i = 0; i < problem.edges.size(); ++i) {
    const DirectionEdge& edge = problem.edges[i];
    if (!result.is_known[edge.node1] || !result.is_known[edge.node2]) continue;
    result.edge_errors_rad[i] = AngleBetweenRad(Baseline(edge, result.cams_in_world), edge.dir_1to2_in_world);
  }
  return result;
}

}  // namespace lazyloc

#include "colmap_lazyloc/translation/translation_averaging.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <ceres/ceres.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

// The line on which an edge puts an unknown node: from a known centre along a direction.
struct Ray {
  Eigen::Vector3d origin;
  Eigen::Vector3d dir;
  double weight;
};

double EdgeStddev(const DirectionEdge& edge, const TranslationAveragingOptions& options) {
  return std::hypot(edge.stddev_rad, DegToRad(options.min_direction_stddev_deg));
}

std::vector<Ray> RaysTo(int node, const TranslationAveragingProblem& problem,
                        const TranslationAveragingOptions& options, const TranslationAveragingResult& result) {
  std::vector<Ray> rays;
  for (const DirectionEdge& edge : problem.edges) {
    const double weight = 1 / EdgeStddev(edge, options);
    if (edge.node2 == node && result.is_known[edge.node1]) {
      rays.push_back({result.cams_in_world[edge.node1], edge.dir_1to2_in_world, weight});
    } else if (edge.node1 == node && result.is_known[edge.node2]) {
      rays.push_back({result.cams_in_world[edge.node2], -edge.dir_1to2_in_world, weight});
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

// Residual (u - dir) / sigma with u = (C2 - C1) / |C2 - C1|; parameters C1, C2.
class ChordCost : public ceres::SizedCostFunction<3, 3, 3> {
 public:
  ChordCost(const Eigen::Vector3d& dir, double stddev) : dir_(dir), weight_(1 / stddev) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Eigen::Vector3d baseline =
        Eigen::Map<const Eigen::Vector3d>(parameters[1]) - Eigen::Map<const Eigen::Vector3d>(parameters[0]);
    const double length = baseline.norm();
    if (length == 0) return false;
    const Eigen::Vector3d unit = baseline / length;
    Eigen::Map<Eigen::Vector3d> residual(residuals);
    residual = weight_ * (unit - dir_);
    if (jacobians == nullptr) return true;
    const Eigen::Matrix3d jacobian = weight_ / length * (Eigen::Matrix3d::Identity() - unit * unit.transpose());
    // Symmetric, so that Ceres' row-major order makes no difference.
    for (int i = 0; i < 2; ++i) {
      if (jacobians[i] == nullptr) continue;
      Eigen::Map<Eigen::Matrix3d> target(jacobians[i]);
      target = i == 0 ? -jacobian : jacobian;
    }
    return true;
  }

 private:
  const Eigen::Vector3d dir_;
  const double weight_;
};

void Minimize(const TranslationAveragingProblem& problem, const TranslationAveragingOptions& options,
              TranslationAveragingResult* result) {
  ceres::CauchyLoss loss(options.loss_scale_sigma);
  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem ceres_problem(problem_options);
  for (const DirectionEdge& edge : problem.edges) {
    if (!result->is_known[edge.node1] || !result->is_known[edge.node2]) continue;
    if (problem.is_fixed[edge.node1] && problem.is_fixed[edge.node2]) continue;
    ceres_problem.AddResidualBlock(new ChordCost(edge.dir_1to2_in_world, EdgeStddev(edge, options)), &loss,
                                   result->cams_in_world[edge.node1].data(), result->cams_in_world[edge.node2].data());
    for (const int node : {edge.node1, edge.node2}) {
      if (problem.is_fixed[node]) ceres_problem.SetParameterBlockConstant(result->cams_in_world[node].data());
    }
  }
  ceres::Solver::Options solver_options;
  solver_options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  if (ceres_problem.NumResidualBlocks() <= 200) solver_options.linear_solver_type = ceres::DENSE_QR;
  solver_options.max_num_iterations = options.max_num_iterations;
  solver_options.function_tolerance = 1e-14;
  solver_options.gradient_tolerance = 1e-14;
  solver_options.parameter_tolerance = 1e-12;
  solver_options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver_options, &ceres_problem, &summary);
  result->summary.success = summary.IsSolutionUsable();
  result->summary.message = summary.message;
  result->summary.iterations = static_cast<int>(summary.iterations.size());
  result->summary.cost = summary.final_cost;
}

}  // namespace

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
  StartFromVotes(problem, options, &result);
  if (result.is_known == problem.is_fixed) {
    result.summary.message = "no unknown position is linked to a fixed one";
    return result;
  }
  Minimize(problem, options, &result);
  for (const DirectionEdge& edge : problem.edges) {
    const bool known = result.is_known[edge.node1] && result.is_known[edge.node2];
    const Eigen::Vector3d baseline = result.cams_in_world[edge.node2] - result.cams_in_world[edge.node1];
    result.edge_errors_rad.push_back(known ? AngleBetweenRad(baseline, edge.dir_1to2_in_world)
                                           : std::numeric_limits<double>::quiet_NaN());
  }
  return result;
}

}  // namespace lazyloc

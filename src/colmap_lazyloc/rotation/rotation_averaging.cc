#include "colmap_lazyloc/rotation/rotation_averaging.h"

#include <algorithm>
#include <limits>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/rotation/rotation_methods.h"
#include "colmap_lazyloc/rotation/rotation_proposals.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

Eigen::Vector3d EdgeErrorInWorld(const RotationEdge& edge, const std::vector<Eigen::Quaterniond>& rotations) {
  const Eigen::Quaterniond world_from_node2_measured =
      rotations[edge.node1].conjugate() * edge.node2_from_node1.conjugate();
  return LogSO3(world_from_node2_measured * rotations[edge.node2]);
}

RotationAveragingResult AverageRotations(const RotationAveragingProblem& problem, RotationAveragingMethod method) {
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
  switch (method) {
    case RotationAveragingMethod::L1_IRLS: AverageByL1Irls(problem, &result); break;
    case RotationAveragingMethod::L1: AverageByL1(problem, &result); break;
    case RotationAveragingMethod::QUATERNION_MEAN: AverageByQuaternionMean(problem, &result); break;
  }
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

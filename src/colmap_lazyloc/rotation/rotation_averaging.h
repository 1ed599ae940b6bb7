#pragma once

#include <string>
#include <vector>

#include <Eigen/Geometry>

#include "colmap_lazyloc/scene/enum_names.h"
#include "colmap_lazyloc/scene/stage_summary.h"

namespace lazyloc {

// Measured relative rotation between two images: R_node2 = node2_from_node1 * R_node1 (R = cam_from_world).
struct RotationEdge {
  int node1 = -1;
  int node2 = -1;
  Eigen::Quaterniond node2_from_node1 = Eigen::Quaterniond::Identity();
  double weight = 1;  // relative trust, e.g. the number of inliers
};

// Rotation averaging with fixed nodes: cam_from_world rotations of nodes 0..n-1, of which the fixed ones are known and
// are returned as they are. Gauge freedom: none, as long as each unknown node is linked to a fixed one.
struct RotationAveragingProblem {
  std::vector<Eigen::Quaterniond> rotations;  // of fixed nodes; the others' are ignored
  std::vector<bool> is_fixed;
  std::vector<RotationEdge> edges;
};

enum class RotationAveragingMethod {
  L1_IRLS,          // minimises the edges' errors in the L1 norm, then under Geman-McClure's loss
  L1,               // the first part of it
  QUATERNION_MEAN,  // squared chords: one wrong edge pulls the result
};
template <>
inline constexpr std::array<const char*, 3> kEnumNames<RotationAveragingMethod> = {"l1_irls", "l1", "quaternion_mean"};

struct RotationAveragingOptions {
  RotationAveragingMethod method = RotationAveragingMethod::L1_IRLS;
  double vote_error_deg = 5;  // an edge supports a start whose rotation it matches within this angle
  int num_l1_iterations = 10;
  int num_irls_iterations = 20;
  double irls_scale_deg = 2;       // Geman-McClure scale
  double convergence_deg = 1e-10;  // end when no rotation moves by more

  bool Check(std::string* error) const;
};

struct RotationAveragingResult {
  std::vector<Eigen::Quaterniond> rotations;
  std::vector<bool> is_known;           // fixed, or linked to a fixed node
  std::vector<double> edge_errors_rad;  // angle between measured and averaged; NaN where a node is not known
  StageSummary summary;
};

// Starts each unknown node at the rotation that most weight of its edges agrees with (exact for one unknown node:
// every edge's proposal is tried), then minimises the edges' errors by the method chosen.
// L1 and IRLS are reweighted least squares in the Lie algebra, with the unknown nodes' columns only: Chatterjee &
// Govindu, Efficient and Robust Large-Scale Rotation Averaging, ICCV 2013; LazyLoc section 3.1. summary.success is
// false where no unknown node is linked to a fixed one, or a measurement is not finite.
RotationAveragingResult AverageRotations(const RotationAveragingProblem& problem,
                                         const RotationAveragingOptions& options);

}  // namespace lazyloc

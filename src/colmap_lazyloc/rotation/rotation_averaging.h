#pragma once

#include <vector>

#include <Eigen/Geometry>

#include "colmap_lazyloc/scene/stage_summary.h"

namespace lazyloc {

// Maximum angle between rotations that agree: several times the error of a good pair.
inline constexpr double kMaxRotationErrorDeg = 5;

// Measured relative rotation between two nodes: R_node2 = node2_from_node1 * R_node1, with R = cam_from_world.
struct RotationEdge {
  int node1 = -1;
  int node2 = -1;
  Eigen::Quaterniond node2_from_node1 = Eigen::Quaterniond::Identity();
  double weight = 1;  // relative weight, for example the number of inliers
};

// Rotation averaging with fixed nodes 0..n-1, each with a cam_from_world rotation. The rotations of fixed nodes are
// known and are returned unchanged. There is no gauge freedom if each unknown node is connected to a fixed node.
struct RotationAveragingProblem {
  std::vector<Eigen::Quaterniond> rotations;  // of n nodes; ignored for nodes that are not fixed
  std::vector<bool> is_fixed;
  std::vector<RotationEdge> edges;
};

struct RotationAveragingResult {
  std::vector<Eigen::Quaterniond> rotations;
  std::vector<bool> is_known;           // true: fixed, or connected to a fixed node
  std::vector<double> edge_errors_rad;  // angle between measured and averaged; NaN if a node is not known
  StageSummary summary;
};

// A method of averaging: changes the rotations of known nodes that are not fixed, starting from result->rotations.
using RotationAverager = void (*)(const RotationAveragingProblem& problem, RotationAveragingResult* result);

// Runs L1, then iteratively reweighted least squares (IRLS) with the Geman-McClure loss. Both are reweighted least
// squares in the Lie algebra, with columns for the unknown nodes only: Chatterjee & Govindu, Efficient and Robust
// Large-Scale Rotation Averaging, ICCV 2013; LazyLoc (arXiv 2307.09981), section 3.1.
void AverageByL1Irls(const RotationAveragingProblem& problem, RotationAveragingResult* result);

// Averages rotations. Starts each unknown node at the proposal of one of its edges, the one that agrees with the
// largest weight of its other edges, and then minimises the edges' errors by the method; another one than the default
// is for comparisons. summary.success is false if no unknown node is connected to a fixed one or if a measurement is
// not finite.
RotationAveragingResult AverageRotations(const RotationAveragingProblem& problem,
                                         RotationAverager average = AverageByL1Irls);

}  // namespace lazyloc

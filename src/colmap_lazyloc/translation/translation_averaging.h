#pragma once

#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/stage_summary.h"

namespace lazyloc {

// Measured direction of the baseline between two nodes: unit vector along cam2_in_world - cam1_in_world.
struct DirectionEdge {
  int node1 = -1;
  int node2 = -1;
  Eigen::Vector3d dir_1to2_in_world = Eigen::Vector3d::Zero();
  double stddev_rad = 0;  // noise of the direction
  // Added to C2 - C1 to give the baseline. Non-zero if the images are cameras of rigs and the nodes are the rigs'
  // centres.
  Eigen::Vector3d offset_in_world = Eigen::Vector3d::Zero();
};

// Translation averaging with fixed nodes 0..n-1, each with a projection centre. The centres of fixed nodes are known
// and are returned unchanged. An edge constrains two of the three coordinates of an unknown node. There is no gauge
// freedom if each unknown node has two fixed neighbours in directions that are not parallel. A node with a single fixed
// neighbour, or on the line through its fixed neighbours, is unobservable along this line.
struct TranslationAveragingProblem {
  std::vector<Eigen::Vector3d> cams_in_world;  // of n nodes; ignored for nodes that are not fixed
  std::vector<bool> is_fixed;
  std::vector<DirectionEdge> edges;
};

struct TranslationAveragingResult {
  std::vector<Eigen::Vector3d> cams_in_world;
  std::vector<bool> is_known;  // true: fixed, or connected to a fixed node
  StageSummary summary;
};

// A method of averaging: changes the centres of known nodes that are not fixed, starting from result->cams_in_world,
// and sets result->summary.
using TranslationAverager = void (*)(const TranslationAveragingProblem& problem, TranslationAveragingResult* result);

// Minimises sum rho(|dir - b / |b||^2 / sigma^2), b = C2 - C1 + offset, by Ceres with the Cauchy loss rho. The chord
// between two unit vectors equals their angle up to third order and increases with it up to 180 degrees. Wilson &
// Snavely, Robust Global Translations with 1DSfM, ECCV 2014, eq. 2; LazyLoc (arXiv 2307.09981), section 3.2.
void AverageByAngles(const TranslationAveragingProblem& problem, TranslationAveragingResult* result);

// Averages translations. Starts each unknown node at the crossing of two of its edges with the largest weight of other
// edges that agree, and then minimises the cost of the method over the unknown centres; another method than the default
// is for comparisons. summary.success is false if no unknown node is connected to a fixed one, if a measurement is not
// finite, or if the solver fails.
TranslationAveragingResult AverageTranslations(const TranslationAveragingProblem& problem,
                                               TranslationAverager average = AverageByAngles);

}  // namespace lazyloc

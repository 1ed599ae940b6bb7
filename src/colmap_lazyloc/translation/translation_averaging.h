#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/enum_names.h"
#include "colmap_lazyloc/scene/stage_summary.h"

namespace lazyloc {

// Measured baseline direction between two images: unit (cam2_in_world - cam1_in_world).
struct DirectionEdge {
  int node1 = -1;
  int node2 = -1;
  Eigen::Vector3d dir_1to2_in_world = Eigen::Vector3d::Zero();
  double stddev_rad = 0;  // noise of the direction
  // Where the images are not at the nodes but fixed to them: what this adds to C2 - C1 (a camera of a rig).
  Eigen::Vector3d offset_in_world = Eigen::Vector3d::Zero();
};

// Translation averaging with fixed nodes: projection centres of nodes 0..n-1, of which the fixed ones are known and
// are returned as they are. An edge binds two of a node's three coordinates. Gauge freedom: none where each unknown
// node sees two or more distinct fixed centres in non-parallel directions; with one fixed neighbour, or on the line of
// its fixed neighbours, its position along the ray stays open (see `is_determined`).
struct TranslationAveragingProblem {
  std::vector<Eigen::Vector3d> cams_in_world;  // of fixed nodes; the others' are ignored
  std::vector<bool> is_fixed;
  std::vector<DirectionEdge> edges;
};

enum class TranslationAveragingMethod {
  ANGULAR,  // sum rho(|dir - b / |b|| / sigma)^2, b = C2 - C1 + offset
  LUD,      // least unsquared deviations: sum min over lambda >= 0 of |b - lambda dir|
};
template <>
inline constexpr std::array<const char*, 2> kEnumNames<TranslationAveragingMethod> = {"angular", "lud"};

struct TranslationAveragingOptions {
  TranslationAveragingMethod method = TranslationAveragingMethod::ANGULAR;
  double min_direction_stddev_deg = 0.1;  // added to each direction's own noise: what its model does not know
  double loss_scale_sigma = 2;            // Cauchy scale in standard deviations of the directions
  double max_vote_error_deg = 10;         // an edge supports a start whose direction it matches within this angle
  double min_ray_angle_deg = 1;           // two directions that meet at less do not determine a start
  int max_num_iterations = 50;

  bool Check(std::string* error) const;
};

struct TranslationAveragingResult {
  std::vector<Eigen::Vector3d> cams_in_world;
  std::vector<bool> is_known;           // fixed, or linked to a fixed node
  std::vector<bool> is_determined;      // fixed, or started where two edges cross
  std::vector<double> edge_errors_rad;  // angle between measured and averaged; NaN where a node is not known
  StageSummary summary;
};

// Starts each unknown node at the crossing of two of its edges that most other edges agree with, then minimises the
// errors of the method chosen over the unknown centres.
// Angular: by Ceres, rho Cauchy's loss; the chord between two unit vectors is their angle up to third order, and grows
// with it up to 180 degrees. Wilson & Snavely, Robust Global Translations with 1DSfM, ECCV 2014, eq. 2; LazyLoc
// section 3.2.
// LUD: convex, by reweighted least squares, all edges weighing the same. Ozyesil & Singer, Robust Camera Location
// Estimation by Convex Programming, CVPR 2015; their lambda >= 1 sets the scale, which the fixed centres do here.
// summary.success is false where no unknown node is linked to a fixed one, or a measurement is not finite.
TranslationAveragingResult AverageTranslations(const TranslationAveragingProblem& problem,
                                               const TranslationAveragingOptions& options);

}  // namespace lazyloc

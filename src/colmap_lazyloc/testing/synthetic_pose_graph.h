#pragma once

#include <vector>

#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {

struct SyntheticPoseGraphOptions {
  int num_database = 20;
  int num_query = 1;
  double rotation_noise_deg = 0;   // angle between measured and true rotation of each edge
  double direction_noise_deg = 0;  // angle between measured and true direction of each edge
  double outlier_edge_ratio = 0;   // ratio of edges with random rotation and direction
  bool database_on_line = false;
  uint32_t seed = 0;
};

// Measured relative rotation and direction of a pair of images.
struct SyntheticPoseGraphEdge {
  int node1 = -1;
  int node2 = -1;
  Eigen::Quaterniond node2_from_node1;
  Eigen::Vector3d dir_1to2_in_world;
};

// Pose graph of cameras within a few units of each other, without points. Every query has an edge to every database
// image and to every other query; the edges are in random order.
struct SyntheticPoseGraph {
  std::vector<Rigid3d> cam_from_world;  // true poses; database images first
  int num_database = 0;
  std::vector<SyntheticPoseGraphEdge> edges;
  int num_outliers = 0;  // the first edges are the outliers

  bool IsFixed(int node) const { return node < num_database; }
  int NumNodes() const { return static_cast<int>(cam_from_world.size()); }
};

SyntheticPoseGraph MakeSyntheticPoseGraph(const SyntheticPoseGraphOptions& options);

}  // namespace lazyloc

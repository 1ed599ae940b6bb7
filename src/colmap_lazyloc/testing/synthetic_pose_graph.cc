#include "colmap_lazyloc/testing/synthetic_pose_graph.h"

#include <algorithm>

namespace lazyloc {

SyntheticPoseGraph MakeSyntheticPoseGraph(const SyntheticPoseGraphOptions& options) {
  Random random(options.seed);
  SyntheticPoseGraph graph;
  graph.num_database = options.num_database;
  for (int node = 0; node < options.num_database + options.num_query; ++node) {
    const Eigen::Quaterniond rotation = RandomRotation(&random);
    Eigen::Vector3d centre = 3 * RandomVector(&random);
    if (options.database_on_line && graph.IsFixed(node)) centre = Eigen::Vector3d(0.5 * node - 5, 0, 0);
    graph.cam_from_world.push_back(CamFromWorld(rotation, centre));
  }
  for (int node2 = options.num_database; node2 < graph.NumNodes(); ++node2) {
    for (int node1 = 0; node1 < node2; ++node1) {
      const Rigid3d &pose1 = graph.cam_from_world[node1], &pose2 = graph.cam_from_world[node2];
      const Eigen::Quaterniond rotation = pose2.rotation * pose1.rotation.conjugate();
      const Eigen::Vector3d dir = (CamInWorld(pose2) - CamInWorld(pose1)).normalized();
      graph.edges.push_back({node1, node2, Disturbed(rotation, options.rotation_noise_deg, &random),
                             DisturbedDirection(dir, options.direction_noise_deg, &random)});
    }
  }
  graph.num_outliers = static_cast<int>(options.outlier_edge_ratio * static_cast<double>(graph.edges.size()));
  std::shuffle(graph.edges.begin(), graph.edges.end(), random);
  for (int i = 0; i < graph.num_outliers; ++i) {
    graph.edges[i].node2_from_node1 = RandomRotation(&random);
    graph.edges[i].dir_1to2_in_world = RandomVector(&random).normalized();
  }
  return graph;
}

}  // namespace lazyloc

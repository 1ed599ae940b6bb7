#include "colmap_lazyloc/rotation/rotation_averaging.h"

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

struct SyntheticPoseGraphOptions {
  int num_database = 20;
  int num_query = 1;
  double rotation_noise_deg = 0;
  double outlier_edge_ratio = 0;
  uint32_t seed = 0;
};

struct SyntheticPoseGraph {
  RotationAveragingProblem problem;  // fixed nodes first
  std::vector<Eigen::Quaterniond> truth;
  int num_outliers = 0;
};

// Every query is linked to every database image and to every other query.
SyntheticPoseGraph MakePoseGraph(const SyntheticPoseGraphOptions& options) {
  Random random(options.seed);
  SyntheticPoseGraph graph;
  for (int node = 0; node < options.num_database + options.num_query; ++node) {
    const bool is_fixed = node < options.num_database;
    graph.truth.push_back(RandomRotation(&random));
    graph.problem.is_fixed.push_back(is_fixed);
    graph.problem.rotations.push_back(is_fixed ? graph.truth.back() : Eigen::Quaterniond::Identity());
  }
  const int num_nodes = static_cast<int>(graph.truth.size());
  std::vector<RotationEdge>& edges = graph.problem.edges;
  for (int node2 = options.num_database; node2 < num_nodes; ++node2) {
    for (int node1 = 0; node1 < node2; ++node1) {
      const Eigen::Quaterniond exact = graph.truth[node2] * graph.truth[node1].conjugate();
      edges.push_back({node1, node2, Disturbed(exact, options.rotation_noise_deg, &random), 100});
    }
  }
  graph.num_outliers = static_cast<int>(options.outlier_edge_ratio * static_cast<double>(edges.size()));
  std::shuffle(edges.begin(), edges.end(), random);
  for (int i = 0; i < graph.num_outliers; ++i) edges[i].node2_from_node1 = RandomRotation(&random);
  return graph;
}

double MaxErrorDeg(const std::vector<Eigen::Quaterniond>& a, const std::vector<Eigen::Quaterniond>& b) {
  double max_error = 0;
  for (size_t i = 0; i < a.size(); ++i) max_error = std::max(max_error, RadToDeg(AngularDistanceRad(a[i], b[i])));
  return max_error;
}

class QueryCounts : public testing::TestWithParam<int> {
 protected:
  SyntheticPoseGraphOptions Options() const {
    SyntheticPoseGraphOptions options;
    options.num_query = GetParam();
    return options;
  }
};

TEST_P(QueryCounts, NoiseFreeIsExact) {
  const SyntheticPoseGraph graph = MakePoseGraph(Options());
  const RotationAveragingResult result = AverageRotations(graph.problem, {});
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  EXPECT_LE(MaxErrorDeg(result.rotations, graph.truth), RadToDeg(1e-8));
}

// 20 edges of 1 deg average to about 1 / sqrt(20) deg each way; with 40 % outliers 12 remain. Five times that.
TEST_P(QueryCounts, WithNoiseAndOutliers) {
  SyntheticPoseGraphOptions options = Options();
  options.rotation_noise_deg = 1;
  options.outlier_edge_ratio = 0.4;
  for (options.seed = 0; options.seed < 20; ++options.seed) {
    const SyntheticPoseGraph graph = MakePoseGraph(options);
    const RotationAveragingResult result = AverageRotations(graph.problem, {});
    ASSERT_TRUE(result.summary.success);
    EXPECT_LE(MaxErrorDeg(result.rotations, graph.truth), 5 / std::sqrt(12)) << "seed " << options.seed;
    const auto num_large = std::count_if(result.edge_errors_rad.begin(), result.edge_errors_rad.end(),
                                         [](double error) { return error > DegToRad(5); });
    EXPECT_NEAR(static_cast<double>(num_large), graph.num_outliers, 2);
  }
}

TEST_P(QueryCounts, KeepsFixedRotationsBitwise) {
  SyntheticPoseGraphOptions options = Options();
  options.rotation_noise_deg = 3;
  SyntheticPoseGraph graph = MakePoseGraph(options);
  graph.problem.rotations[0].coeffs() *= 1 + 1e-12;
  const RotationAveragingResult result = AverageRotations(graph.problem, {});
  for (int node = 0; node < options.num_database; ++node) {
    EXPECT_EQ(result.rotations[node].coeffs(), graph.problem.rotations[node].coeffs());
  }
}

TEST_P(QueryCounts, EdgeOrientationDoesNotMatter) {
  SyntheticPoseGraphOptions options = Options();
  options.rotation_noise_deg = 1;
  SyntheticPoseGraph graph = MakePoseGraph(options);
  const RotationAveragingResult straight = AverageRotations(graph.problem, {});
  for (size_t i = 0; i < graph.problem.edges.size(); i += 2) {
    RotationEdge& edge = graph.problem.edges[i];
    std::swap(edge.node1, edge.node2);
    edge.node2_from_node1 = edge.node2_from_node1.conjugate();
  }
  const RotationAveragingResult swapped = AverageRotations(graph.problem, {});
  EXPECT_LE(MaxErrorDeg(straight.rotations, swapped.rotations), 1e-6);
}

TEST_P(QueryCounts, TurningTheWorldTurnsTheResult) {
  SyntheticPoseGraphOptions options = Options();
  options.rotation_noise_deg = 1;
  SyntheticPoseGraph graph = MakePoseGraph(options);
  const RotationAveragingResult before = AverageRotations(graph.problem, {});
  Random random(99);
  const Eigen::Quaterniond old_from_new_world = RandomRotation(&random);
  for (Eigen::Quaterniond& rotation : graph.problem.rotations) rotation = rotation * old_from_new_world;
  const RotationAveragingResult after = AverageRotations(graph.problem, {});
  for (size_t node = 0; node < graph.truth.size(); ++node) {
    EXPECT_LE(AngularDistanceRad(after.rotations[node], before.rotations[node] * old_from_new_world), 1e-8);
  }
}

INSTANTIATE_TEST_SUITE_P(RotationAveraging, QueryCounts, testing::Values(1, 5));

TEST(RotationAveraging, UnlinkedQueryIsReported) {
  SyntheticPoseGraphOptions options;
  options.num_query = 2;
  SyntheticPoseGraph graph = MakePoseGraph(options);
  std::vector<RotationEdge>& edges = graph.problem.edges;
  const int unlinked = options.num_database + 1;
  edges.erase(
      std::remove_if(edges.begin(), edges.end(),
                     [&](const RotationEdge& edge) { return edge.node1 == unlinked || edge.node2 == unlinked; }),
      edges.end());
  edges.push_back({unlinked, unlinked - 1, Eigen::Quaterniond::Identity(), 0});
  const RotationAveragingResult result = AverageRotations(graph.problem, {});
  EXPECT_TRUE(result.summary.success);
  EXPECT_FALSE(result.is_known[unlinked]);
  EXPECT_TRUE(std::isnan(result.edge_errors_rad.back()));
  EXPECT_LE(RadToDeg(AngularDistanceRad(result.rotations[unlinked - 1], graph.truth[unlinked - 1])), 1e-6);
}

TEST(RotationAveraging, NoFixedNodeFails) {
  RotationAveragingProblem problem;
  problem.rotations.resize(2, Eigen::Quaterniond::Identity());
  problem.is_fixed = {false, false};
  problem.edges.push_back({0, 1, Eigen::Quaterniond::Identity(), 1});
  const RotationAveragingResult result = AverageRotations(problem, {});
  EXPECT_FALSE(result.summary.success);
  EXPECT_THAT(result.summary.message, testing::HasSubstr("fixed"));
}

TEST(RotationAveraging, EmptyProblem) { EXPECT_FALSE(AverageRotations({}, {}).summary.success); }

TEST(RotationAveragingOptions, NamesTheInvalidField) {
  RotationAveragingOptions options;
  std::string error;
  EXPECT_TRUE(options.Check(&error));
  options.irls_scale_deg = -1;
  EXPECT_FALSE(options.Check(&error));
  EXPECT_THAT(error, testing::HasSubstr("irls_scale_deg must be > 0, but is -1"));
}

}  // namespace
}  // namespace lazyloc

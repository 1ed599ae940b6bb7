#pragma once

// The contract of methods of rotation averaging, for the tests of each: a test program includes it and instantiates
// EveryRotationMethod, and RobustRotationMethod for robust methods.

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <tuple>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/rotation/rotation_averaging.h"
#include "colmap_lazyloc/testing/synthetic_pose_graph.h"

namespace lazyloc {

inline RotationAveragingProblem ProblemOf(const SyntheticPoseGraph& graph) {
  RotationAveragingProblem problem;
  for (int node = 0; node < graph.NumNodes(); ++node) {
    problem.is_fixed.push_back(graph.IsFixed(node));
    problem.rotations.push_back(graph.IsFixed(node) ? graph.cam_from_world[node].rotation
                                                    : Eigen::Quaterniond::Identity());
  }
  for (const SyntheticPoseGraphEdge& edge : graph.edges) {
    problem.edges.push_back({edge.node1, edge.node2, edge.node2_from_node1, 100});
  }
  return problem;
}

inline double MaxErrorDeg(const std::vector<Eigen::Quaterniond>& a, const std::vector<Eigen::Quaterniond>& b) {
  double max_error = 0;
  for (size_t i = 0; i < a.size(); ++i) max_error = std::max(max_error, RadToDeg(AngularDistanceRad(a[i], b[i])));
  return max_error;
}

inline double MaxErrorDeg(const RotationAveragingResult& result, const SyntheticPoseGraph& graph) {
  std::vector<Eigen::Quaterniond> truth;
  for (const Rigid3d& pose : graph.cam_from_world) truth.push_back(pose.rotation);
  return MaxErrorDeg(result.rotations, truth);
}

// A method with the name of its tests.
struct NamedRotationAverager {
  const char* name;
  RotationAverager average;
};

// Contract of the methods. Parameters: the method and the number of queries.
class RotationAveragingContract : public testing::TestWithParam<std::tuple<NamedRotationAverager, int>> {
 protected:
  RotationAveragingResult Average(const RotationAveragingProblem& problem) const {
    return AverageRotations(problem, std::get<0>(GetParam()).average);
  }

  SyntheticPoseGraphOptions GraphOptions(double rotation_noise_deg) const {
    SyntheticPoseGraphOptions options;
    options.num_query = std::get<1>(GetParam());
    options.rotation_noise_deg = rotation_noise_deg;
    return options;
  }
};

// Contract that every method must fulfil.
using EveryRotationMethod = RotationAveragingContract;
// Contract of the robust methods.
using RobustRotationMethod = RotationAveragingContract;
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(RobustRotationMethod);

TEST_P(EveryRotationMethod, NoiseFreeIsExact) {
  const SyntheticPoseGraph graph = MakeSyntheticPoseGraph(GraphOptions(0));
  const RotationAveragingResult result = Average(ProblemOf(graph));
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  EXPECT_LE(MaxErrorDeg(result, graph), RadToDeg(1e-8));
}

// Averaging 20 edges with errors of 1 deg leaves about 1 / sqrt(20) deg. Allows five times as much.
TEST_P(EveryRotationMethod, AveragesNoise) {
  SyntheticPoseGraphOptions options = GraphOptions(1);
  for (options.seed = 0; options.seed < 20; ++options.seed) {
    const SyntheticPoseGraph graph = MakeSyntheticPoseGraph(options);
    const RotationAveragingResult result = Average(ProblemOf(graph));
    ASSERT_TRUE(result.summary.success);
    EXPECT_LE(MaxErrorDeg(result, graph), 5 / std::sqrt(20)) << "seed " << options.seed;
  }
}

TEST_P(EveryRotationMethod, KeepsFixedRotationsBitwise) {
  RotationAveragingProblem problem = ProblemOf(MakeSyntheticPoseGraph(GraphOptions(3)));
  problem.rotations[0].coeffs() *= 1 + 1e-12;
  const RotationAveragingResult result = Average(problem);
  for (size_t node = 0; node < problem.rotations.size(); ++node) {
    if (problem.is_fixed[node]) {
      EXPECT_EQ(result.rotations[node].coeffs(), problem.rotations[node].coeffs());
    }
  }
}

TEST_P(EveryRotationMethod, EdgeOrderDoesNotMatter) {
  RotationAveragingProblem problem = ProblemOf(MakeSyntheticPoseGraph(GraphOptions(1)));
  const RotationAveragingResult straight = Average(problem);
  std::reverse(problem.edges.begin(), problem.edges.end());
  EXPECT_LE(MaxErrorDeg(Average(problem).rotations, straight.rotations), RadToDeg(1e-12));
}

TEST_P(EveryRotationMethod, EdgeOrientationDoesNotMatter) {
  RotationAveragingProblem problem = ProblemOf(MakeSyntheticPoseGraph(GraphOptions(1)));
  const RotationAveragingResult straight = Average(problem);
  for (size_t i = 0; i < problem.edges.size(); i += 2) {
    RotationEdge& edge = problem.edges[i];
    std::swap(edge.node1, edge.node2);
    edge.node2_from_node1 = edge.node2_from_node1.conjugate();
  }
  EXPECT_LE(MaxErrorDeg(Average(problem).rotations, straight.rotations), RadToDeg(1e-12));
}

TEST_P(EveryRotationMethod, TurningTheWorldTurnsTheResult) {
  RotationAveragingProblem problem = ProblemOf(MakeSyntheticPoseGraph(GraphOptions(1)));
  const RotationAveragingResult before = Average(problem);
  Random random(99);
  const Eigen::Quaterniond old_from_new_world = RandomRotation(&random);
  for (Eigen::Quaterniond& rotation : problem.rotations) rotation = rotation * old_from_new_world;
  const RotationAveragingResult after = Average(problem);
  for (size_t node = 0; node < problem.rotations.size(); ++node) {
    EXPECT_LE(AngularDistanceRad(after.rotations[node], before.rotations[node] * old_from_new_world), 1e-12);
  }
}

TEST_P(EveryRotationMethod, UnlinkedQueryIsReported) {
  RotationAveragingProblem problem = ProblemOf(MakeSyntheticPoseGraph(GraphOptions(0)));
  const Eigen::Quaterniond untouched(0, 0, 0, std::numeric_limits<double>::quiet_NaN());
  const int unlinked = static_cast<int>(problem.rotations.size());
  problem.rotations.push_back(untouched);
  problem.is_fixed.push_back(false);
  problem.edges.push_back({unlinked, 0, Eigen::Quaterniond::Identity(), 0});
  const RotationAveragingResult result = Average(problem);
  EXPECT_TRUE(result.summary.success) << result.summary.message;
  EXPECT_FALSE(result.is_known[unlinked]);
  EXPECT_TRUE(std::isnan(result.edge_errors_rad.back()));
  EXPECT_LE(*std::max_element(result.edge_errors_rad.begin(), result.edge_errors_rad.end() - 1), 1e-8);
}

TEST_P(EveryRotationMethod, DegenerateInputFails) {
  EXPECT_FALSE(Average({}).summary.success);
  const RotationAveragingProblem whole = ProblemOf(MakeSyntheticPoseGraph(GraphOptions(1)));
  RotationAveragingProblem problem = whole;
  problem.edges.clear();
  EXPECT_FALSE(Average(problem).summary.success);
  problem = whole;
  std::fill(problem.is_fixed.begin(), problem.is_fixed.end(), false);
  EXPECT_FALSE(Average(problem).summary.success);
  EXPECT_THAT(Average(problem).summary.message, testing::HasSubstr("fixed"));
  problem = whole;
  problem.edges[3].node2_from_node1.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(Average(problem).summary.success);
  EXPECT_EQ(Average(problem).edge_errors_rad.size(), problem.edges.size());
}

// Leaves 12 good edges, because 40 % are outliers. Allows five times the error of their mean.
TEST_P(RobustRotationMethod, WithstandsOutliers) {
  SyntheticPoseGraphOptions options = GraphOptions(1);
  options.outlier_edge_ratio = 0.4;
  for (options.seed = 0; options.seed < 20; ++options.seed) {
    const SyntheticPoseGraph graph = MakeSyntheticPoseGraph(options);
    const RotationAveragingResult result = Average(ProblemOf(graph));
    ASSERT_TRUE(result.summary.success);
    EXPECT_LE(MaxErrorDeg(result, graph), 5 / std::sqrt(12)) << "seed " << options.seed;
    const auto num_large = std::count_if(result.edge_errors_rad.begin(), result.edge_errors_rad.end(),
                                         [](double error) { return error > DegToRad(5); });
    EXPECT_NEAR(static_cast<double>(num_large), graph.num_outliers, 2);
  }
}

inline std::string NameOf(const testing::TestParamInfo<std::tuple<NamedRotationAverager, int>>& info) {
  const auto& [method, num_query] = info.param;
  return method.name + std::string("_") + std::to_string(num_query);
}

}  // namespace lazyloc

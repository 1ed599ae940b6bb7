#pragma once

// The contract of methods of translation averaging, for the tests of each: a test program includes it and instantiates
// EveryTranslationMethod.

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <tuple>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/synthetic_pose_graph.h"
#include "colmap_lazyloc/translation/translation_averaging.h"

namespace lazyloc {

inline TranslationAveragingProblem ProblemOf(const SyntheticPoseGraph& graph, double stddev_deg) {
  TranslationAveragingProblem problem;
  for (int node = 0; node < graph.NumNodes(); ++node) {
    problem.is_fixed.push_back(graph.IsFixed(node));
    problem.cams_in_world.push_back(graph.IsFixed(node) ? CamInWorld(graph.cam_from_world[node])
                                                        : Eigen::Vector3d::Zero());
  }
  for (const SyntheticPoseGraphEdge& edge : graph.edges) {
    problem.edges.push_back({edge.node1, edge.node2, edge.dir_1to2_in_world, DegToRad(stddev_deg)});
  }
  return problem;
}

inline double MaxError(const std::vector<Eigen::Vector3d>& a, const std::vector<Eigen::Vector3d>& b) {
  double max_error = 0;
  for (size_t i = 0; i < a.size(); ++i) max_error = std::max(max_error, (a[i] - b[i]).norm());
  return max_error;
}

inline double MaxError(const TranslationAveragingResult& result, const SyntheticPoseGraph& graph) {
  std::vector<Eigen::Vector3d> truth;
  for (const Rigid3d& pose : graph.cam_from_world) truth.push_back(CamInWorld(pose));
  return MaxError(result.cams_in_world, truth);
}

// A method with the name of its tests.
struct NamedTranslationAverager {
  const char* name;
  TranslationAverager average;
};

// Contract that every method must fulfil. Parameters: the method and the number of queries.
class EveryTranslationMethod : public testing::TestWithParam<std::tuple<NamedTranslationAverager, int>> {
 protected:
  TranslationAveragingResult Average(const TranslationAveragingProblem& problem) const {
    return AverageTranslations(problem, std::get<0>(GetParam()).average);
  }

  SyntheticPoseGraphOptions GraphOptions(double direction_noise_deg) const {
    SyntheticPoseGraphOptions options;
    options.num_query = std::get<1>(GetParam());
    options.direction_noise_deg = direction_noise_deg;
    return options;
  }

  TranslationAveragingProblem Make(double direction_noise_deg) const {
    return ProblemOf(MakeSyntheticPoseGraph(GraphOptions(direction_noise_deg)), direction_noise_deg);
  }
};

// Allows 1e-8 of the distances, which are about 5 units.
TEST_P(EveryTranslationMethod, NoiseFreeIsExact) {
  for (const bool on_line : {false, true}) {
    SyntheticPoseGraphOptions options = GraphOptions(0);
    options.database_on_line = on_line;
    const SyntheticPoseGraph graph = MakeSyntheticPoseGraph(options);
    const TranslationAveragingResult result = Average(ProblemOf(graph, 0));
    ASSERT_TRUE(result.summary.success) << result.summary.message;
    EXPECT_LE(MaxError(result, graph), 1e-8 * 5);
  }
}

// Averages 20 directions with errors of 1 deg, or 0.09 units over 5 units. A quarter of that remains, more for a query
// far outside. Allows seven times as much.
TEST_P(EveryTranslationMethod, AveragesNoise) {
  SyntheticPoseGraphOptions options = GraphOptions(1);
  for (options.seed = 0; options.seed < 20; ++options.seed) {
    const SyntheticPoseGraph graph = MakeSyntheticPoseGraph(options);
    const TranslationAveragingResult result = Average(ProblemOf(graph, 1));
    ASSERT_TRUE(result.summary.success);
    EXPECT_LE(MaxError(result, graph), 7 * 0.02) << "seed " << options.seed;
  }
}

TEST_P(EveryTranslationMethod, KeepsFixedCentresBitwise) {
  const TranslationAveragingProblem problem = Make(3);
  const TranslationAveragingResult result = Average(problem);
  for (size_t node = 0; node < problem.is_fixed.size(); ++node) {
    if (problem.is_fixed[node]) {
      EXPECT_EQ(result.cams_in_world[node], problem.cams_in_world[node]);
    }
  }
}

TEST_P(EveryTranslationMethod, EdgeOrderDoesNotMatter) {
  TranslationAveragingProblem problem = Make(1);
  const TranslationAveragingResult straight = Average(problem);
  std::reverse(problem.edges.begin(), problem.edges.end());
  EXPECT_LE(MaxError(Average(problem).cams_in_world, straight.cams_in_world), 1e-12);
}

TEST_P(EveryTranslationMethod, EdgeOrientationDoesNotMatter) {
  TranslationAveragingProblem problem = Make(1);
  const TranslationAveragingResult straight = Average(problem);
  for (size_t i = 0; i < problem.edges.size(); i += 2) {
    DirectionEdge& edge = problem.edges[i];
    std::swap(edge.node1, edge.node2);
    edge.dir_1to2_in_world *= -1;
  }
  EXPECT_LE(MaxError(Average(problem).cams_in_world, straight.cams_in_world), 1e-12);
}

TEST_P(EveryTranslationMethod, FollowsScaleAndRotationOfTheDatabase) {
  TranslationAveragingProblem problem = Make(1);
  const TranslationAveragingResult before = Average(problem);
  Random random(99);
  const Eigen::Quaterniond rotation = RandomRotation(&random);
  const auto moved = [&](const Eigen::Vector3d& centre) -> Eigen::Vector3d { return 100 * (rotation * centre); };
  for (Eigen::Vector3d& centre : problem.cams_in_world) centre = moved(centre);
  for (DirectionEdge& edge : problem.edges) edge.dir_1to2_in_world = rotation * edge.dir_1to2_in_world;
  const TranslationAveragingResult after = Average(problem);
  for (size_t node = 0; node < problem.is_fixed.size(); ++node) {
    EXPECT_LE((after.cams_in_world[node] - moved(before.cams_in_world[node])).norm(), 1e-4);
  }
}

TEST_P(EveryTranslationMethod, OneNeighbourTellsTheBearing) {
  SyntheticPoseGraphOptions options;
  options.num_database = 1;
  const TranslationAveragingProblem problem = ProblemOf(MakeSyntheticPoseGraph(options), 0);
  const TranslationAveragingResult result = Average(problem);
  EXPECT_TRUE(result.summary.success);
  const DirectionEdge& edge = problem.edges[0];
  EXPECT_LE(
      AngleBetweenRad(result.cams_in_world[edge.node2] - result.cams_in_world[edge.node1], edge.dir_1to2_in_world),
      1e-8);
}

TEST_P(EveryTranslationMethod, QueryOnTheLineOfItsNeighboursStaysFinite) {
  SyntheticPoseGraphOptions options;
  options.database_on_line = true;
  TranslationAveragingProblem problem = ProblemOf(MakeSyntheticPoseGraph(options), 0);
  for (DirectionEdge& edge : problem.edges) {
    edge.dir_1to2_in_world = Eigen::Vector3d(problem.cams_in_world[edge.node1].x() < 0 ? 1 : -1, 0, 0);
  }
  const TranslationAveragingResult result = Average(problem);
  EXPECT_TRUE(result.cams_in_world.back().allFinite());
}

TEST_P(EveryTranslationMethod, DegenerateInputFails) {
  EXPECT_FALSE(Average({}).summary.success);
  const TranslationAveragingProblem whole = Make(1);
  TranslationAveragingProblem problem = whole;
  problem.edges.clear();
  EXPECT_FALSE(Average(problem).summary.success);
  EXPECT_THAT(Average(problem).summary.message, testing::HasSubstr("fixed"));
  problem = whole;
  problem.edges[3].dir_1to2_in_world.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(Average(problem).summary.success);
}

inline std::string NameOf(const testing::TestParamInfo<std::tuple<NamedTranslationAverager, int>>& info) {
  const auto& [method, num_query] = info.param;
  return method.name + std::string("_") + std::to_string(num_query);
}

}  // namespace lazyloc

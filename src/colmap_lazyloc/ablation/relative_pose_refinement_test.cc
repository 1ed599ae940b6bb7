#include "colmap_lazyloc/ablation/relative_pose_refinement.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/synthetic_pose_graph.h"

namespace lazyloc {
namespace {

struct Scene {
  std::vector<View> truth;
  std::vector<View> start;  // free views off the truth by 1 deg and 0.1 units
  std::vector<RelativePoseEdge> edges;
};

// From the fixed views to the free ones, as relative poses. Distances are about 5 units.
Scene MakeScene(const SyntheticPoseGraphOptions& options) {
  const SyntheticPoseGraph graph = MakeSyntheticPoseGraph(options);
  Random random(options.seed + 1000);
  Scene scene;
  for (int node = 0; node < graph.NumNodes(); ++node) {
    const Rigid3d& pose = graph.cam_from_world[node];
    scene.truth.push_back({pose, graph.IsFixed(node)});
    scene.start.push_back(scene.truth.back());
    if (graph.IsFixed(node)) continue;
    scene.start.back().cam_from_world =
        CamFromWorld(Disturbed(pose.rotation, 1, &random), CamInWorld(pose) + 0.1 * RandomVector(&random).normalized());
  }
  for (const SyntheticPoseGraphEdge& edge : graph.edges) {
    if (!graph.IsFixed(edge.node1)) continue;
    const Eigen::Vector3d free_in_fixed = graph.cam_from_world[edge.node1].rotation * edge.dir_1to2_in_world;
    scene.edges.push_back({edge.node1, edge.node2, CamFromWorld(edge.node2_from_node1, free_in_fixed)});
  }
  return scene;
}

double MaxPositionError(const std::vector<View>& a, const std::vector<View>& b) {
  double max_error = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    max_error = std::max(max_error, PositionError(a[i].cam_from_world, b[i].cam_from_world));
  }
  return max_error;
}

double MaxRotationErrorDeg(const std::vector<View>& a, const std::vector<View>& b) {
  double max_error = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    max_error = std::max(max_error, RotationErrorDeg(a[i].cam_from_world, b[i].cam_from_world));
  }
  return max_error;
}

class RelativePoseContract : public testing::TestWithParam<int> {
 protected:
  SyntheticPoseGraphOptions GraphOptions(double noise_deg) const {
    SyntheticPoseGraphOptions options;
    options.num_query = GetParam();
    options.rotation_noise_deg = options.direction_noise_deg = noise_deg;
    return options;
  }
};

TEST_P(RelativePoseContract, NoiseFreeIsExact) {
  Scene scene = MakeScene(GraphOptions(0));
  const StageSummary summary = RefineByRelativePoses({}, scene.edges, 0, &scene.start);
  ASSERT_TRUE(summary.success) << summary.message;
  EXPECT_LE(MaxPositionError(scene.start, scene.truth), 5 * 1e-8);
  EXPECT_LE(MaxRotationErrorDeg(scene.start, scene.truth), RadToDeg(1e-8));
}

// Some 14 good directions of 1 deg over 5 units leave 0.09 / sqrt(14) units, more far outside. Five times that on
// average.
TEST_P(RelativePoseContract, WithstandsNoiseAndOutliers) {
  SyntheticPoseGraphOptions options = GraphOptions(1);
  options.outlier_edge_ratio = 0.3;
  double error_sum = 0;
  for (options.seed = 0; options.seed < 20; ++options.seed) {
    Scene scene = MakeScene(options);
    ASSERT_TRUE(RefineByRelativePoses({}, scene.edges, 0, &scene.start).success);
    error_sum += MaxPositionError(scene.start, scene.truth);
    EXPECT_LE(MaxRotationErrorDeg(scene.start, scene.truth), 5 / std::sqrt(14)) << "seed " << options.seed;
  }
  EXPECT_LE(error_sum / 20, 5 * 0.024);
}

TEST_P(RelativePoseContract, KeepsFixedPosesBitwise) {
  Scene scene = MakeScene(GraphOptions(1));
  ASSERT_TRUE(RefineByRelativePoses({}, scene.edges, 0, &scene.start).success);
  for (size_t view = 0; view < scene.truth.size(); ++view) {
    if (!scene.truth[view].is_database) continue;
    const Rigid3d &before = scene.truth[view].cam_from_world, &after = scene.start[view].cam_from_world;
    EXPECT_EQ(after.rotation.coeffs(), before.rotation.coeffs());
    EXPECT_EQ(after.translation, before.translation);
  }
}

TEST_P(RelativePoseContract, EdgeOrderDoesNotMatterButTheSeedMay) {
  Scene scene = MakeScene(GraphOptions(2));
  std::vector<View> straight = scene.start, reversed = scene.start, reseeded = scene.start;
  ASSERT_TRUE(RefineByRelativePoses({}, scene.edges, 0, &straight).success);
  ASSERT_TRUE(RefineByRelativePoses({}, scene.edges, 1, &reseeded).success);
  std::reverse(scene.edges.begin(), scene.edges.end());
  ASSERT_TRUE(RefineByRelativePoses({}, scene.edges, 0, &reversed).success);
  EXPECT_EQ(MaxPositionError(straight, reversed), 0);
  EXPECT_EQ(MaxRotationErrorDeg(straight, reversed), 0);
  EXPECT_LE(MaxPositionError(straight, reseeded), 0.3);
}

INSTANTIATE_TEST_SUITE_P(RelativePoseRefinement, RelativePoseContract, testing::Values(1, 3));

// An outlier of the translation alone does not vote on the rotation either.
TEST(RelativePoseRefinement, WrongDirectionsAreLeftOutWithTheirRotations) {
  SyntheticPoseGraphOptions options;
  options.num_database = 6;
  Scene scene = MakeScene(options);
  Rigid3d& wrong = scene.edges[2].free_from_fixed;
  wrong = CamFromWorld(ExpSO3({0.3, 0, 0}) * wrong.rotation, -CamInWorld(wrong));
  ASSERT_TRUE(RefineByRelativePoses({}, scene.edges, 0, &scene.start).success);
  EXPECT_LE(MaxRotationErrorDeg(scene.start, scene.truth), RadToDeg(1e-8));
}

TEST(RelativePoseRefinement, DegenerateInputFailsAndChangesNothing) {
  SyntheticPoseGraphOptions options;
  options.num_database = 3;
  const Scene scene = MakeScene(options);
  const auto fails = [&](const std::vector<RelativePoseEdge>& edges) {
    std::vector<View> views = scene.start;
    const bool success = RefineByRelativePoses({}, edges, 0, &views).success;
    return !success && views.back().cam_from_world.translation == scene.start.back().cam_from_world.translation;
  };
  EXPECT_FALSE(fails(scene.edges));
  EXPECT_TRUE(fails({}));
  EXPECT_TRUE(fails({scene.edges[0]})) << "one line";
  std::vector<RelativePoseEdge> edges = scene.edges;
  for (RelativePoseEdge& edge : edges) edge.free_from_fixed.translation.setZero();
  EXPECT_TRUE(fails(edges)) << "panoramic";
  for (RelativePoseEdge& edge : edges) {
    edge.free_from_fixed.translation.setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  EXPECT_TRUE(fails(edges)) << "not a number";
}

TEST(RelativePoseRefinement, ParallelLinesFail) {
  std::vector<View> views = {{CamFromWorld(Eigen::Quaterniond::Identity(), {0, 0, 0}), true},
                             {CamFromWorld(Eigen::Quaterniond::Identity(), {1, 0, 0}), true},
                             {CamFromWorld(Eigen::Quaterniond::Identity(), {3, 0, 0}), false}};
  const Rigid3d ahead = CamFromWorld(Eigen::Quaterniond::Identity(), {1, 0, 0});
  const StageSummary summary = RefineByRelativePoses({}, {{0, 2, ahead}, {1, 2, ahead}}, 0, &views);
  EXPECT_FALSE(summary.success);
  EXPECT_THAT(summary.message, testing::HasSubstr("agree"));
}

TEST(RelativePoseRefinementOptions, NamesTheInvalidField) {
  RelativePoseRefinementOptions options;
  std::string error;
  EXPECT_TRUE(options.Check(&error));
  options.max_direction_error_deg = 0;
  EXPECT_FALSE(options.Check(&error));
  EXPECT_THAT(error, testing::HasSubstr("max_direction_error_deg"));
}

}  // namespace
}  // namespace lazyloc

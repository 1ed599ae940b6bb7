#include "relative_pose_refinement.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/pose_expectations.h"
#include "colmap_lazyloc/testing/synthetic_pose_graph.h"

namespace lazyloc {
namespace {

struct Scene {
  PosedImages truth;
  PosedImages start;  // queries off the truth by 1 deg and 0.1 units
  std::vector<RelativePoseEdge> edges;
};

// Makes single images with relative poses from the database images to the queries. Distances are about 5 units.
Scene MakeScene(const SyntheticPoseGraphOptions& options) {
  const SyntheticPoseGraph graph = MakeSyntheticPoseGraph(options);
  Random random(options.seed + 1000);
  Scene scene;
  for (int node = 0; node < graph.NumNodes(); ++node) {
    Image image;
    image.frame = node;
    scene.truth.images.push_back(image);
    Frame frame;
    frame.frame_from_world = graph.cam_from_world[node];
    frame.is_database = graph.IsFixed(node);
    scene.truth.frames.push_back(frame);
  }
  scene.start = scene.truth;
  for (Frame& frame : scene.start.frames) {
    Rigid3d& pose = frame.frame_from_world;
    if (frame.is_database) continue;
    const Eigen::Quaterniond rotation = Disturbed(pose.rotation, 1, &random);
    pose = CamFromWorld(rotation, CamInWorld(pose) + 0.1 * RandomVector(&random).normalized());
  }
  for (const SyntheticPoseGraphEdge& edge : graph.edges) {
    if (!graph.IsFixed(edge.node1)) continue;
    const Eigen::Vector3d query_in_database = graph.cam_from_world[edge.node1].rotation * edge.dir_1to2_in_world;
    scene.edges.push_back({edge.node1, edge.node2, CamFromWorld(edge.node2_from_node1, query_in_database)});
  }
  return scene;
}

double MaxPositionError(const PosedImages& a, const PosedImages& b) {
  double max_error = 0;
  for (int i = 0; i < static_cast<int>(a.images.size()); ++i) {
    max_error = std::max(max_error, PositionError(CamFromWorld(a, i), CamFromWorld(b, i)));
  }
  return max_error;
}

double MaxRotationErrorDeg(const PosedImages& a, const PosedImages& b) {
  double max_error = 0;
  for (int i = 0; i < static_cast<int>(a.images.size()); ++i) {
    max_error = std::max(max_error, RotationErrorDeg(CamFromWorld(a, i), CamFromWorld(b, i)));
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
  const Scene scene = MakeScene(GraphOptions(0));
  const PoseRefinementResult result = RefineByRelativePoses(scene.start, scene.edges, 0);
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  EXPECT_LE(MaxPositionError(result.posed, scene.truth), 5 * 1e-8);
  EXPECT_LE(MaxRotationErrorDeg(result.posed, scene.truth), RadToDeg(1e-8));
}

// Allows five times the average error: about 14 good directions of 1 deg over 5 units leave 0.09 / sqrt(14) units, and
// more far outside.
TEST_P(RelativePoseContract, WithstandsNoiseAndOutliers) {
  SyntheticPoseGraphOptions options = GraphOptions(1);
  options.outlier_edge_ratio = 0.3;
  double error_sum = 0;
  for (options.seed = 0; options.seed < 20; ++options.seed) {
    const Scene scene = MakeScene(options);
    const PoseRefinementResult result = RefineByRelativePoses(scene.start, scene.edges, 0);
    ASSERT_TRUE(result.summary.success);
    error_sum += MaxPositionError(result.posed, scene.truth);
    EXPECT_LE(MaxRotationErrorDeg(result.posed, scene.truth), 5 / std::sqrt(14)) << "seed " << options.seed;
  }
  EXPECT_LE(error_sum / 20, 5 * 0.024);
}

TEST_P(RelativePoseContract, KeepsDatabasePosesBitwise) {
  const Scene scene = MakeScene(GraphOptions(1));
  const PoseRefinementResult result = RefineByRelativePoses(scene.start, scene.edges, 0);
  ASSERT_TRUE(result.summary.success);
  for (size_t i = 0; i < scene.truth.frames.size(); ++i) {
    if (!scene.truth.frames[i].is_database) continue;
    ExpectSameBits(result.posed.frames[i].frame_from_world, scene.truth.frames[i].frame_from_world);
  }
}

TEST_P(RelativePoseContract, EdgeOrderDoesNotMatterButTheSeedMay) {
  Scene scene = MakeScene(GraphOptions(2));
  const PoseRefinementResult straight = RefineByRelativePoses(scene.start, scene.edges, 0);
  const PoseRefinementResult reseeded = RefineByRelativePoses(scene.start, scene.edges, 1);
  std::reverse(scene.edges.begin(), scene.edges.end());
  const PoseRefinementResult reversed = RefineByRelativePoses(scene.start, scene.edges, 0);
  ASSERT_TRUE(straight.summary.success && reseeded.summary.success && reversed.summary.success);
  EXPECT_EQ(MaxPositionError(straight.posed, reversed.posed), 0);
  EXPECT_EQ(MaxRotationErrorDeg(straight.posed, reversed.posed), 0);
  EXPECT_LE(MaxPositionError(straight.posed, reseeded.posed), 0.3);
}

INSTANTIATE_TEST_SUITE_P(RelativePoseRefinement, RelativePoseContract, testing::Values(1, 3));

// Makes an outlier of the translation alone, and expects that its rotation is not used either.
TEST(RelativePoseRefinement, WrongDirectionsAreLeftOutWithTheirRotations) {
  SyntheticPoseGraphOptions options;
  options.num_database = 6;
  Scene scene = MakeScene(options);
  Rigid3d& wrong = scene.edges[2].query_from_database;
  wrong = CamFromWorld(ExpSO3({0.3, 0, 0}) * wrong.rotation, -CamInWorld(wrong));
  const PoseRefinementResult result = RefineByRelativePoses(scene.start, scene.edges, 0);
  ASSERT_TRUE(result.summary.success);
  EXPECT_LE(MaxRotationErrorDeg(result.posed, scene.truth), RadToDeg(1e-8));
}

TEST(RelativePoseRefinement, DegenerateInputFailsAndChangesNothing) {
  SyntheticPoseGraphOptions options;
  options.num_database = 3;
  const Scene scene = MakeScene(options);
  const auto fails = [&](const std::vector<RelativePoseEdge>& edges) {
    const PoseRefinementResult result = RefineByRelativePoses(scene.start, edges, 0);
    if (result.summary.success) return false;
    ExpectSameBits(result.posed.frames.back().frame_from_world, scene.start.frames.back().frame_from_world);
    return true;
  };
  EXPECT_FALSE(fails(scene.edges));
  EXPECT_TRUE(fails({}));
  EXPECT_TRUE(fails({scene.edges[0]})) << "one line";
  std::vector<RelativePoseEdge> edges = scene.edges;
  for (RelativePoseEdge& edge : edges) edge.query_from_database.translation.setZero();
  EXPECT_TRUE(fails(edges)) << "panoramic";
  for (RelativePoseEdge& edge : edges) {
    edge.query_from_database.translation.setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  EXPECT_TRUE(fails(edges)) << "not a number";
}

TEST(RelativePoseRefinement, ParallelLinesFail) {
  PosedImages posed;
  for (const double x : {0, 1, 3}) {
    Frame frame;
    frame.frame_from_world = CamFromWorld(Eigen::Quaterniond::Identity(), {x, 0, 0});
    frame.is_database = x < 3;
    Image image;
    image.frame = static_cast<int>(posed.frames.size());
    posed.frames.push_back(frame);
    posed.images.push_back(image);
  }
  const Rigid3d ahead = CamFromWorld(Eigen::Quaterniond::Identity(), {1, 0, 0});
  const StageSummary summary = RefineByRelativePoses(posed, {{0, 2, ahead}, {1, 2, ahead}}, 0).summary;
  EXPECT_FALSE(summary.success);
  EXPECT_THAT(summary.message, testing::HasSubstr("agree"));
}

}  // namespace
}  // namespace lazyloc

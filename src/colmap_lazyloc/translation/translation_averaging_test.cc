#include "colmap_lazyloc/translation/translation_averaging.h"

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

struct SyntheticDirectionsOptions {
  int num_database = 20;
  int num_query = 1;
  double direction_noise_deg = 0;
  double outlier_edge_ratio = 0;
  bool database_on_line = false;
  uint32_t seed = 0;
};

struct SyntheticDirections {
  TranslationAveragingProblem problem;  // fixed nodes first
  std::vector<Eigen::Vector3d> truth;
};

// Centres within a few units; every query linked to every database image and to every other query.
SyntheticDirections MakeDirections(const SyntheticDirectionsOptions& options) {
  Random random(options.seed);
  SyntheticDirections scene;
  for (int node = 0; node < options.num_database + options.num_query; ++node) {
    const bool is_fixed = node < options.num_database;
    Eigen::Vector3d centre = 3 * RandomVector(&random);
    if (options.database_on_line && is_fixed) centre = Eigen::Vector3d(0.5 * node - 5, 0, 0);
    scene.truth.push_back(centre);
    scene.problem.is_fixed.push_back(is_fixed);
    scene.problem.cams_in_world.push_back(is_fixed ? centre : Eigen::Vector3d::Zero());
  }
  std::vector<DirectionEdge>& edges = scene.problem.edges;
  for (int node2 = options.num_database; node2 < static_cast<int>(scene.truth.size()); ++node2) {
    for (int node1 = 0; node1 < node2; ++node1) {
      const Eigen::Vector3d exact = (scene.truth[node2] - scene.truth[node1]).normalized();
      edges.push_back({node1, node2, DisturbedDirection(exact, options.direction_noise_deg, &random),
                       DegToRad(options.direction_noise_deg)});
    }
  }
  std::shuffle(edges.begin(), edges.end(), random);
  for (size_t i = 0; i < options.outlier_edge_ratio * static_cast<double>(edges.size()); ++i) {
    edges[i].dir_1to2_in_world = RandomVector(&random).normalized();
  }
  return scene;
}

double MaxError(const std::vector<Eigen::Vector3d>& a, const std::vector<Eigen::Vector3d>& b) {
  double max_error = 0;
  for (size_t i = 0; i < a.size(); ++i) max_error = std::max(max_error, (a[i] - b[i]).norm());
  return max_error;
}

class QueryCounts : public testing::TestWithParam<int> {
 protected:
  SyntheticDirectionsOptions Options() const {
    SyntheticDirectionsOptions options;
    options.num_query = GetParam();
    return options;
  }
};

TEST_P(QueryCounts, NoiseFreeIsExact) {
  for (const bool on_line : {false, true}) {
    SyntheticDirectionsOptions options = Options();
    options.database_on_line = on_line;
    const SyntheticDirections scene = MakeDirections(options);
    const TranslationAveragingResult result = AverageTranslations(scene.problem, {});
    ASSERT_TRUE(result.summary.success) << result.summary.message;
    EXPECT_LE(MaxError(result.cams_in_world, scene.truth), 1e-8 * 5);
    EXPECT_THAT(result.is_determined, testing::Each(true));
  }
}

// Directions of 1 deg over 5 units are 0.09 units off; 12 good ones leave a third of that, more for
// a query far outside. Seven times that.
TEST_P(QueryCounts, WithNoiseAndOutliers) {
  SyntheticDirectionsOptions options = Options();
  options.direction_noise_deg = 1;
  options.outlier_edge_ratio = 0.4;
  for (options.seed = 0; options.seed < 20; ++options.seed) {
    const SyntheticDirections scene = MakeDirections(options);
    const TranslationAveragingResult result = AverageTranslations(scene.problem, {});
    ASSERT_TRUE(result.summary.success);
    EXPECT_LE(MaxError(result.cams_in_world, scene.truth), 7 * 0.03) << "seed " << options.seed;
  }
}

TEST_P(QueryCounts, KeepsFixedCentresBitwise) {
  SyntheticDirectionsOptions options = Options();
  options.direction_noise_deg = 3;
  const SyntheticDirections scene = MakeDirections(options);
  const TranslationAveragingResult result = AverageTranslations(scene.problem, {});
  for (int node = 0; node < options.num_database; ++node) {
    EXPECT_EQ(result.cams_in_world[node], scene.problem.cams_in_world[node]);
  }
}

TEST_P(QueryCounts, EdgeOrientationDoesNotMatter) {
  SyntheticDirectionsOptions options = Options();
  options.direction_noise_deg = 1;
  SyntheticDirections scene = MakeDirections(options);
  const TranslationAveragingResult straight = AverageTranslations(scene.problem, {});
  for (size_t i = 0; i < scene.problem.edges.size(); i += 2) {
    DirectionEdge& edge = scene.problem.edges[i];
    std::swap(edge.node1, edge.node2);
    edge.dir_1to2_in_world *= -1;
  }
  EXPECT_LE(MaxError(AverageTranslations(scene.problem, {}).cams_in_world, straight.cams_in_world), 1e-6);
}

TEST_P(QueryCounts, FollowsScaleAndRotationOfTheDatabase) {
  SyntheticDirectionsOptions options = Options();
  options.direction_noise_deg = 1;
  SyntheticDirections scene = MakeDirections(options);
  const TranslationAveragingResult before = AverageTranslations(scene.problem, {});
  Random random(99);
  const Eigen::Quaterniond rotation = RandomRotation(&random);
  const auto moved = [&](const Eigen::Vector3d& centre) -> Eigen::Vector3d { return 100 * (rotation * centre); };
  for (Eigen::Vector3d& centre : scene.problem.cams_in_world) centre = moved(centre);
  for (DirectionEdge& edge : scene.problem.edges) edge.dir_1to2_in_world = rotation * edge.dir_1to2_in_world;
  const TranslationAveragingResult after = AverageTranslations(scene.problem, {});
  for (size_t node = 0; node < scene.truth.size(); ++node) {
    EXPECT_LE((after.cams_in_world[node] - moved(before.cams_in_world[node])).norm(), 1e-4);
  }
}

INSTANTIATE_TEST_SUITE_P(TranslationAveraging, QueryCounts, testing::Values(1, 5));

TEST(TranslationAveraging, OneNeighbourLeavesTheDistanceOpen) {
  SyntheticDirectionsOptions options;
  options.num_database = 1;
  const SyntheticDirections scene = MakeDirections(options);
  const TranslationAveragingResult result = AverageTranslations(scene.problem, {});
  EXPECT_TRUE(result.summary.success);
  EXPECT_FALSE(result.is_determined[1]);
  EXPECT_LE(result.edge_errors_rad[0], 1e-8) << "the bearing is known all the same";
}

TEST(TranslationAveraging, QueryOnTheLineOfItsNeighboursIsOpen) {
  SyntheticDirectionsOptions options;
  options.database_on_line = true;
  SyntheticDirections scene = MakeDirections(options);
  for (DirectionEdge& edge : scene.problem.edges) {
    edge.dir_1to2_in_world = Eigen::Vector3d(scene.truth[edge.node1].x() < 0 ? 1 : -1, 0, 0);
  }
  EXPECT_FALSE(AverageTranslations(scene.problem, {}).is_determined.back());
}

TEST(TranslationAveraging, UnlinkedQueryFails) {
  SyntheticDirections scene = MakeDirections({});
  scene.problem.edges.clear();
  EXPECT_FALSE(AverageTranslations(scene.problem, {}).summary.success);
  EXPECT_FALSE(AverageTranslations({}, {}).summary.success);
}

TEST(TranslationAveragingOptions, NamesTheInvalidField) {
  TranslationAveragingOptions options;
  std::string error;
  EXPECT_TRUE(options.Check(&error));
  options.loss_scale_sigma = 0;
  EXPECT_FALSE(options.Check(&error));
  EXPECT_THAT(error, testing::HasSubstr("loss_scale_sigma"));
}

}  // namespace
}  // namespace lazyloc

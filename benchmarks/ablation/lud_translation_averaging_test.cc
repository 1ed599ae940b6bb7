#include "averaging_methods.h"
#include "colmap_lazyloc/translation/translation_averaging_test_contract.h"

namespace lazyloc {
namespace {

const NamedTranslationAverager kLud = {"lud", AverageByLeastUnsquaredDeviations};
INSTANTIATE_TEST_SUITE_P(LeastUnsquaredDeviations, EveryTranslationMethod,
                         testing::Combine(testing::Values(kLud), testing::Values(1, 5)), NameOf);

// Checks exact recovery (Ozyesil & Singer): a few outliers do not change the minimum if all other directions are exact.
TEST(LeastUnsquaredDeviations, AreExactDespiteFewOutliers) {
  SyntheticPoseGraphOptions options;
  options.outlier_edge_ratio = 0.1;
  for (options.seed = 0; options.seed < 20; ++options.seed) {
    const SyntheticPoseGraph graph = MakeSyntheticPoseGraph(options);
    const TranslationAveragingResult result =
        AverageTranslations(ProblemOf(graph, 0), AverageByLeastUnsquaredDeviations);
    EXPECT_LE(MaxError(result, graph), 1e-7 * 5) << "seed " << options.seed;
  }
}

// Tests a weakness of LUD: the cost of an outlier grows with its length, and edges between queries have no cost if the
// queries collapse into one point.
TEST(LeastUnsquaredDeviations, YieldToManyOutliers) {
  SyntheticPoseGraphOptions options;
  options.num_query = 5;
  options.direction_noise_deg = 1;
  options.outlier_edge_ratio = 0.2;
  double angular_sum = 0, lud_sum = 0;
  for (options.seed = 0; options.seed < 20; ++options.seed) {
    const SyntheticPoseGraph graph = MakeSyntheticPoseGraph(options);
    angular_sum += MaxError(AverageTranslations(ProblemOf(graph, 1)), graph);
    lud_sum += MaxError(AverageTranslations(ProblemOf(graph, 1), AverageByLeastUnsquaredDeviations), graph);
  }
  EXPECT_GT(lud_sum, 3 * angular_sum);
}

// Places a query among 6 near and 14 distant database images with equally accurate directions, but for two outliers.
// Angular errors do not depend on the distance, whereas the deviations of LUD are largest for distant images.
TEST(LeastUnsquaredDeviations, LoseToAnglesWhereDistancesDiffer) {
  double angular_sum = 0, lud_sum = 0;
  for (uint32_t seed = 0; seed < 50; ++seed) {
    Random random(seed);
    TranslationAveragingProblem problem;
    problem.cams_in_world.emplace_back(Eigen::Vector3d::Zero());
    problem.is_fixed.push_back(false);
    for (int node = 1; node <= 20; ++node) {
      const double distance = node <= 6 ? 1 : 30;
      problem.cams_in_world.emplace_back(distance * RandomVector(&random).normalized());
      problem.is_fixed.push_back(true);
      const Eigen::Vector3d dir = DisturbedDirection(-problem.cams_in_world[node].normalized(), 1, &random);
      problem.edges.push_back({node, 0, node % 10 == 0 ? RandomVector(&random).normalized() : dir, DegToRad(1)});
    }
    angular_sum += AverageTranslations(problem).cams_in_world[0].norm();
    lud_sum += AverageTranslations(problem, AverageByLeastUnsquaredDeviations).cams_in_world[0].norm();
  }
  EXPECT_LE(angular_sum / 50, 2 * DegToRad(1)) << "six good directions from one unit away";
  EXPECT_GT(lud_sum, 3 * angular_sum);
}

}  // namespace
}  // namespace lazyloc

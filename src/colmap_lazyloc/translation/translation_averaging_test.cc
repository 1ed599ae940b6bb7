#include "colmap_lazyloc/translation/translation_averaging.h"

#include "colmap_lazyloc/translation/translation_averaging_test_contract.h"

namespace lazyloc {
namespace {

const NamedTranslationAverager kAngular = {"angular", AverageByAngles};
INSTANTIATE_TEST_SUITE_P(TranslationAveraging, EveryTranslationMethod,
                         testing::Combine(testing::Values(kAngular), testing::Values(1, 5)), NameOf);

// Leaves 12 good directions, because 40 % are outliers, and so an error of 0.03 units. Allows seven times as much.
TEST(TranslationAveraging, AnglesWithstandManyOutliers) {
  SyntheticPoseGraphOptions options;
  options.direction_noise_deg = 1;
  options.outlier_edge_ratio = 0.4;
  for (const int num_query : {1, 5}) {
    options.num_query = num_query;
    for (options.seed = 0; options.seed < 20; ++options.seed) {
      const SyntheticPoseGraph graph = MakeSyntheticPoseGraph(options);
      const TranslationAveragingResult result = AverageTranslations(ProblemOf(graph, 1));
      ASSERT_TRUE(result.summary.success);
      EXPECT_LE(MaxError(result, graph), 7 * 0.03) << "seed " << options.seed;
    }
  }
}

}  // namespace
}  // namespace lazyloc

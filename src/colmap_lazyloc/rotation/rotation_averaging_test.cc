#include "colmap_lazyloc/rotation/rotation_averaging.h"

#include "colmap_lazyloc/rotation/rotation_averaging_test_contract.h"
#include "colmap_lazyloc/rotation/rotation_methods.h"

namespace lazyloc {
namespace {

const NamedRotationAverager kL1Irls = {"l1_irls", AverageByL1Irls}, kL1 = {"l1", AverageByL1};
const auto kParameters = testing::Combine(testing::Values(kL1Irls, kL1), testing::Values(1, 5));

INSTANTIATE_TEST_SUITE_P(RotationAveraging, EveryRotationMethod, kParameters, NameOf);
INSTANTIATE_TEST_SUITE_P(RotationAveragingRobust, RobustRotationMethod, kParameters, NameOf);

// Compares the methods on 20 % outliers: they do not affect the Geman-McClure loss; in L1 their directions count.
TEST(RotationAveraging, MethodsDifferByWhatOutliersDo) {
  SyntheticPoseGraphOptions options;
  options.outlier_edge_ratio = 0.2;
  options.rotation_noise_deg = 0.5;
  double irls_sum = 0, l1_sum = 0;
  for (options.seed = 0; options.seed < 20; ++options.seed) {
    const SyntheticPoseGraph graph = MakeSyntheticPoseGraph(options);
    irls_sum += MaxErrorDeg(AverageRotations(ProblemOf(graph)), graph);
    l1_sum += MaxErrorDeg(AverageRotations(ProblemOf(graph), AverageByL1), graph);
  }
  EXPECT_LT(irls_sum, 0.9 * l1_sum);
}

}  // namespace
}  // namespace lazyloc

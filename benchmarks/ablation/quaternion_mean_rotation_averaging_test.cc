#include "averaging_methods.h"
#include "colmap_lazyloc/rotation/rotation_averaging_test_contract.h"
#include "colmap_lazyloc/rotation/rotation_methods.h"

namespace lazyloc {
namespace {

const NamedRotationAverager kQuaternionMean = {"quaternion_mean", AverageByQuaternionMean};
INSTANTIATE_TEST_SUITE_P(QuaternionMean, EveryRotationMethod,
                         testing::Combine(testing::Values(kQuaternionMean), testing::Values(1, 5)), NameOf);

// Compares with L1 on 20 % outliers: only their directions count in L1, in the mean also their sizes.
TEST(QuaternionMean, YieldsToOutliers) {
  SyntheticPoseGraphOptions options;
  options.outlier_edge_ratio = 0.2;
  options.rotation_noise_deg = 0.5;
  double l1_sum = 0, mean_sum = 0;
  for (options.seed = 0; options.seed < 20; ++options.seed) {
    const SyntheticPoseGraph graph = MakeSyntheticPoseGraph(options);
    l1_sum += MaxErrorDeg(AverageRotations(ProblemOf(graph), AverageByL1), graph);
    mean_sum += MaxErrorDeg(AverageRotations(ProblemOf(graph), AverageByQuaternionMean), graph);
  }
  EXPECT_LT(l1_sum, 0.1 * mean_sum);
}

}  // namespace
}  // namespace lazyloc

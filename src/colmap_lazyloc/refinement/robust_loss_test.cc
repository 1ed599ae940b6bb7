#include "colmap_lazyloc/refinement/robust_loss.h"

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

TEST(RobustLoss, SumOfALongTrackIsFinite) {
  const RobustLoss loss(1);
  RobustLoss::Sum sum(loss);
  constexpr int kNumObservations = 5000;
  for (int i = 0; i < kNumObservations; ++i) EXPECT_DOUBLE_EQ(sum.Add(16), 1.0 / 17);
  EXPECT_NEAR(sum.Value(), 0.5 * kNumObservations * std::log(17), 1e-8);
}

}  // namespace
}  // namespace lazyloc

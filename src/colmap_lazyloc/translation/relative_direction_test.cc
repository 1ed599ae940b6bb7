#include "colmap_lazyloc/translation/relative_direction.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

struct Baseline {
  std::vector<RayMatch> rays;
  Eigen::Vector3d direction;
};

Baseline MakeBaseline(int num_rays, double noise_rad, double outlier_ratio, double length, uint32_t seed) {
  Random random(seed);
  Baseline baseline;
  baseline.direction = RandomVector(&random).normalized();
  for (int i = 0; i < num_rays; ++i) {
    const Eigen::Vector3d point = Eigen::Vector3d(0, 0, 10) + 3 * RandomVector(&random);
    const Eigen::Vector3d ray1 = (point + noise_rad * point.norm() * RandomVector(&random)).normalized();
    Eigen::Vector3d to_point = point - length * baseline.direction;
    if (i < outlier_ratio * num_rays) to_point = Eigen::Vector3d(0, 0, 10) + 3 * RandomVector(&random);
    const Eigen::Vector3d ray2 = (to_point + noise_rad * to_point.norm() * RandomVector(&random)).normalized();
    baseline.rays.push_back({ray1, ray2, std::max(noise_rad, 1e-6), std::max(noise_rad, 1e-6)});
  }
  return baseline;
}

TEST(RelativeDirection, NoiseFreeIsExact) {
  for (uint32_t seed = 0; seed < 20; ++seed) {
    const Baseline baseline = MakeBaseline(50, 0, 0, 1, seed);
    const RelativeDirection result = EstimateRelativeDirection(baseline.rays);
    EXPECT_LE(AngleBetweenRad(result.dir_1to2_in_world, baseline.direction), 1e-8) << seed;
  }
}

// Allows four standard deviations of the estimate in 20 trials, with and without outliers.
TEST(RelativeDirection, ErrorKeepsToItsStandardDeviation) {
  for (const double outlier_ratio : {0.0, 0.2}) {
    for (uint32_t seed = 0; seed < 20; ++seed) {
      const Baseline baseline = MakeBaseline(200, 1e-3, outlier_ratio, 1, seed);
      const RelativeDirection result = EstimateRelativeDirection(baseline.rays);
      EXPECT_LE(AngleBetweenRad(result.dir_1to2_in_world, baseline.direction), 4 * result.stddev_rad) << seed;
      EXPECT_LE(result.stddev_rad, DegToRad(0.5));
    }
  }
}

TEST(RelativeDirection, MissingBaselineHasNoDirection) {
  for (uint32_t seed = 0; seed < 20; ++seed) {
    const Baseline baseline = MakeBaseline(200, 1e-3, 0, 1e-4, seed);
    EXPECT_TRUE(EstimateRelativeDirection(baseline.rays).dir_1to2_in_world.isZero());
  }
}

TEST(RelativeDirection, TooFewRaysTellNothing) {
  EXPECT_TRUE(EstimateRelativeDirection({}).dir_1to2_in_world.isZero());
  EXPECT_TRUE(EstimateRelativeDirection(MakeBaseline(1, 0, 0, 1, 0).rays).dir_1to2_in_world.isZero());
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/math/two_rays.h"

#include <cmath>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

const Eigen::Vector3d kPoint(0.3, -0.2, 8), kOrigin(1, 2, 3), kOtherOrigin(2, 2.2, 2.5);

Ray RayTo(const Eigen::Vector3d& point, const Eigen::Vector3d& origin) {
  return {origin, (point - origin).normalized()};
}

TEST(FindNearestPoints, MeasuresTheDistancesOfTheirPoint) {
  const Ray a = RayTo(kPoint, kOrigin), b = RayTo(kPoint, kOtherOrigin);
  const auto nearest = FindNearestPoints(a.dir, b.dir, b.origin - a.origin);
  ASSERT_TRUE(nearest.has_value());
  EXPECT_NEAR(nearest->distance1, (kPoint - kOrigin).norm(), 1e-12);
  EXPECT_NEAR(nearest->distance2, (kPoint - kOtherOrigin).norm(), 1e-12);
  EXPECT_TRUE(nearest->AreAhead());
}

TEST(FindNearestPoints, AreJoinedAtRightAnglesToRaysThatMiss) {
  const Ray a = RayTo(kPoint, kOrigin), b = RayTo(kPoint + Eigen::Vector3d(0.1, 0.3, -0.2), kOtherOrigin);
  const auto nearest = FindNearestPoints(a.dir, b.dir, b.origin - a.origin);
  ASSERT_TRUE(nearest.has_value());
  const Eigen::Vector3d gap = b.origin + nearest->distance2 * b.dir - (a.origin + nearest->distance1 * a.dir);
  ASSERT_GT(gap.norm(), 0.01);
  EXPECT_NEAR(gap.dot(a.dir), 0, 1e-12);
  EXPECT_NEAR(gap.dot(b.dir), 0, 1e-12);
  EXPECT_LE((*Crossing(a, b) - (a.origin + nearest->distance1 * a.dir + gap / 2)).norm(), 1e-12);
}

TEST(FindNearestPoints, AreNegativeBehindTheOrigins) {
  const Ray a = RayTo(kPoint, kOrigin), b = RayTo(kPoint, kOtherOrigin);
  const auto nearest = FindNearestPoints(-a.dir, b.dir, b.origin - a.origin);
  ASSERT_TRUE(nearest.has_value());
  EXPECT_LT(nearest->distance1, 0);
  EXPECT_GT(nearest->distance2, 0);
  EXPECT_FALSE(Crossing({a.origin, -a.dir}, b).has_value());
  EXPECT_FALSE(Crossing(a, {b.origin, -b.dir}).has_value());
  EXPECT_TRUE(Crossing(a, b).has_value());
}

TEST(FindNearestPoints, NoneOfNearlyParallelRays) {
  const Eigen::Vector3d baseline(1, 0, 0), dir(0, 0, 1);
  for (const double sine : {0.0, 0.9 * kMinCrossingSine, 1.1 * kMinCrossingSine}) {
    const Eigen::Vector3d other_dir(-sine, 0, std::sqrt(1 - sine * sine));
    EXPECT_EQ(FindNearestPoints(dir, other_dir, baseline).has_value(), sine > kMinCrossingSine);
    EXPECT_EQ(FindNearestPoints(dir, -other_dir, baseline).has_value(), sine > kMinCrossingSine);
  }
}

}  // namespace
}  // namespace lazyloc

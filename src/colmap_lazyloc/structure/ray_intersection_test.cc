#include "colmap_lazyloc/structure/ray_intersection.h"

#include <vector>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace lazyloc {
namespace {

struct Ray {
  Eigen::Vector3d origin, direction;
};

std::vector<Ray> RaysToward(const Eigen::Vector3d& point, double noise) {
  std::vector<Ray> rays;
  for (const Eigen::Vector3d& origin :
       {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(1, 0.2, 0), Eigen::Vector3d(-1, 1, 3)}) {
    const double sign = rays.size() == 1 ? -1 : 1;
    const Eigen::Vector3d error = noise * Eigen::Vector3d(1 - origin.x(), sign, origin.z());
    rays.push_back({origin, sign * (point + error - origin).normalized()});
  }
  return rays;
}

std::optional<Eigen::Vector3d> Intersect(const std::vector<Ray>& rays) {
  RayIntersection intersection;
  for (const Ray& ray : rays) intersection.Add(ray.origin, ray.direction);
  return intersection.Point();
}

double SquaredDistance(const std::vector<Ray>& rays, const Eigen::Vector3d& point) {
  double sum = 0;
  for (const Ray& ray : rays) sum += (point - ray.origin).cross(ray.direction).squaredNorm();
  return sum;
}

TEST(RayIntersection, IsExactWhereTheRaysMeet) {
  for (const Eigen::Vector3d& point : {Eigen::Vector3d(0.3, -0.2, 8), Eigen::Vector3d(500, 2, -1)}) {
    EXPECT_LE((*Intersect(RaysToward(point, 0)) - point).norm(), 1e-9 * point.norm());
  }
}

TEST(RayIntersection, IsNearestToTheRays) {
  const std::vector<Ray> rays = RaysToward({0.3, -0.2, 8}, 0.1);
  const Eigen::Vector3d point = *Intersect(rays);
  ASSERT_GT(SquaredDistance(rays, point), 1e-4);
  for (int axis = 0; axis < 3; ++axis) {
    for (const double step : {-1e-3, 1e-3}) {
      EXPECT_GT(SquaredDistance(rays, point + step * Eigen::Vector3d::Unit(axis)), SquaredDistance(rays, point));
    }
  }
}

TEST(RayIntersection, MovesWithTheWorld) {
  std::vector<Ray> rays = RaysToward({0.3, -0.2, 8}, 0.1);
  const Eigen::Vector3d point = *Intersect(rays), shift(100, -50, 20);
  for (Ray& ray : rays) ray.origin += shift;
  EXPECT_LE((*Intersect(rays) - (point + shift)).norm(), 1e-9);
}

TEST(RayIntersection, NoneOfParallelRays) {
  for (const Eigen::Vector3d& direction :
       {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0.6, 0, 0.8), Eigen::Vector3d(0, 0, 1)}) {
    EXPECT_FALSE(
        Intersect({{Eigen::Vector3d(1, 2, 3), direction}, {Eigen::Vector3d(0, 1, 0), -direction}}).has_value());
  }
  EXPECT_FALSE(Intersect({}).has_value());
}

}  // namespace
}  // namespace lazyloc

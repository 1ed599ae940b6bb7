// Compares our triangulation with COLMAP's.

#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/triangulation.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/structure/ray_intersection.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

// Both minimise the sum of squared distances from the rays, ours with the homogeneous coordinate fixed at 1, COLMAP's
// with all four coordinates normalised to unit length. The noise moves the point by about kDistance * kNoiseRad /
// sqrt(num_images); the difference must be smaller.
TEST(RayIntersection, AgreesWithColmapOnThreeOrMoreRays) {
  constexpr double kNoiseRad = 1e-3, kDistance = 10;
  for (const int num_images : {3, 5, 20}) {
    for (uint32_t seed = 0; seed < 20; ++seed) {
      Random random(seed);
      const Eigen::Vector3d point = RandomVector(&random);
      std::vector<Rigid3d> cams_from_world;
      std::vector<Eigen::Vector3d> rays_in_cam;
      RayIntersection intersection;
      for (int i = 0; i < num_images; ++i) {
        const Eigen::Vector3d cam_in_world = kDistance * RandomVector(&random).normalized();
        cams_from_world.push_back(LookAt(cam_in_world, RandomVector(&random)));
        const Eigen::Vector3d ray = (cams_from_world[i] * point).normalized();
        rays_in_cam.push_back(DisturbedDirection(ray, RadToDeg(kNoiseRad), &random));
        intersection.Add(cam_in_world, cams_from_world[i].rotation.conjugate() * rays_in_cam[i]);
      }
      const std::optional<Triangulation> colmap =
          TriangulateTrack(cams_from_world, rays_in_cam, /*max_angular_error_rad=*/DegToRad(2),
                           /*min_triangulation_angle_rad=*/DegToRad(1.5));
      ASSERT_TRUE(colmap.has_value());
      const Eigen::Vector3d ours = *intersection.Point();
      EXPECT_LE((ours - colmap->point_in_world).norm(), kDistance * kNoiseRad / num_images)
          << num_images << " images, seed " << seed;
    }
  }
}

}  // namespace
}  // namespace lazyloc

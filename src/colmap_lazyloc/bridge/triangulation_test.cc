#include "colmap_lazyloc/bridge/triangulation.h"

#include <future>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

const double kMaxErrorRad = DegToRad(2), kMinAngleRad = DegToRad(1.5);

struct Observations {
  std::vector<Rigid3d> cams_from_world;
  std::vector<Eigen::Vector3d> rays_in_cam;

  void Add(const Rigid3d& cam_from_world, const Eigen::Vector3d& ray_in_cam) {
    cams_from_world.push_back(cam_from_world);
    rays_in_cam.push_back(ray_in_cam);
  }
  std::optional<Triangulation> Triangulate(double min_angle_rad = kMinAngleRad) const {
    return TriangulateTrack(cams_from_world, rays_in_cam, kMaxErrorRad, min_angle_rad);
  }
};

// Makes cameras at distances of about 10 that look near the point. The rays of the first num_outliers miss it by 5 to
// 15 degrees.
Observations Observe(const Eigen::Vector3d& point, int num_images, double noise_rad, int num_outliers, uint32_t seed) {
  Random random(seed);
  Observations observations;
  for (int i = 0; i < num_images; ++i) {
    const Eigen::Vector3d cam_in_world = 10 * RandomVector(&random).normalized() + RandomVector(&random);
    const Rigid3d cam_from_world = LookAt(cam_in_world, RandomVector(&random));
    const Eigen::Vector3d ray = (cam_from_world * point).normalized();
    const double angle_deg = i < num_outliers ? 5 + 10 * i / num_outliers : RadToDeg(noise_rad);
    observations.Add(cam_from_world, DisturbedDirection(ray, angle_deg, &random));
  }
  return observations;
}

TEST(TriangulateTrack, NoiseFreeIsExact) {
  const Eigen::Vector3d point(0.3, -0.2, 0.5);
  for (const int num_images : {2, 3, 20}) {
    for (uint32_t seed = 0; seed < 20; ++seed) {
      const std::optional<Triangulation> result = Observe(point, num_images, 0, 0, seed).Triangulate();
      ASSERT_TRUE(result.has_value()) << num_images << " images, seed " << seed;
      EXPECT_LE((result->point_in_world - point).norm(), 1e-9) << num_images << " images, seed " << seed;
    }
  }
}

// Nine good rays of 1e-3 rad from a distance of 10 leave an error of about 0.005. Four times that.
TEST(TriangulateTrack, FindsOutliers) {
  const Eigen::Vector3d point(0.3, -0.2, 0.5);
  for (uint32_t seed = 0; seed < 20; ++seed) {
    const std::optional<Triangulation> result = Observe(point, 14, 1e-3, 5, seed).Triangulate();
    ASSERT_TRUE(result.has_value());
    ASSERT_EQ(result->is_inlier.size(), 14u);
    for (int i = 0; i < 14; ++i) EXPECT_EQ(result->is_inlier[i], i >= 5) << "image " << i << ", seed " << seed;
    EXPECT_LE((result->point_in_world - point).norm(), 0.02) << "seed " << seed;
  }
}

TEST(TriangulateTrack, NeedsTwoObservations) {
  const Observations observations = Observe({0, 0, 0}, 1, 0, 0, /*seed=*/1);
  EXPECT_FALSE(observations.Triangulate().has_value());
  EXPECT_FALSE(Observations().Triangulate().has_value());
}

TEST(TriangulateTrack, NeedsAnIntersectionInFrontOfTheCameras) {
  const Rigid3d left = CamFromWorld(Eigen::Quaterniond::Identity(), {-1, 0, 0});
  const Rigid3d right = CamFromWorld(Eigen::Quaterniond::Identity(), {1, 0, 0});
  const Eigen::Vector3d to_left = Eigen::Vector3d(-1, 0, 10).normalized(), to_right = {-to_left.x(), 0, to_left.z()};
  Observations converging, diverging;
  converging.Add(left, to_right);
  converging.Add(right, to_left);
  diverging.Add(left, to_left);
  diverging.Add(right, to_right);
  EXPECT_TRUE(converging.Triangulate().has_value());
  EXPECT_FALSE(diverging.Triangulate().has_value());
}

TEST(TriangulateTrack, NeedsTheMinimumAngle) {
  Observations observations;  // of the point (0, 0, 10), under an angle of 0.01 rad
  observations.Add(CamFromWorld(Eigen::Quaterniond::Identity(), {0, 0, 0}), {0, 0, 1});
  observations.Add(CamFromWorld(Eigen::Quaterniond::Identity(), {0.1, 0, 0}), {-0.1, 0, 10});
  EXPECT_TRUE(observations.Triangulate(/*min_angle_rad=*/0.009).has_value());
  EXPECT_FALSE(observations.Triangulate(/*min_angle_rad=*/0.011).has_value());
}

TEST(TriangulateTrack, RefusesRaysThatDoNotPointForward) {
  Observations observations = Observe({0, 0, 0}, 5, 1e-4, 0, /*seed=*/1);
  ASSERT_TRUE(observations.Triangulate().has_value());
  for (const double z : {0.0, -0.1}) {
    observations.rays_in_cam.back() = {1, 0, z};
    EXPECT_FALSE(observations.Triangulate().has_value());
  }
}

TEST(TriangulateTrack, SameInputGivesTheSameBytesOnEveryThread) {
  const Observations observations = Observe({1, 2, 3}, 12, 1e-3, 5, /*seed=*/3);
  const std::optional<Triangulation> first = observations.Triangulate();
  Observe({0, 0, 0}, 9, 1e-3, 3, /*seed=*/4).Triangulate();
  const std::optional<Triangulation> on_other_thread =
      std::async(std::launch::async, [&] { return observations.Triangulate(); }).get();
  for (const std::optional<Triangulation>& again : {observations.Triangulate(), on_other_thread}) {
    ASSERT_TRUE(first && again);
    EXPECT_EQ(first->point_in_world, again->point_in_world);
    EXPECT_EQ(first->is_inlier, again->is_inlier);
  }
}

}  // namespace
}  // namespace lazyloc

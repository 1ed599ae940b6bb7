#include <atomic>
#include <thread>

#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/absolute_pose.h"
#include "colmap_lazyloc/bridge/random_numbers.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

const double kNoiseDeg = 0.05;

// Estimates the pose of two cameras, 0.5 apart, that observe 50 points with noise from a distance of about 10.
std::optional<Rigid3d> EstimatePairPose(double max_error_rad = DegToRad(3 * kNoiseDeg)) {
  Random random(1);
  const Rigid3d reference_from_world = LookAt(10 * RandomVector(&random).normalized(), Eigen::Vector3d::Zero());
  std::vector<Eigen::Vector3d> rays, points;
  std::vector<Rigid3d> cams_from_reference;
  for (int i = 0; i < 50; ++i) {
    points.push_back(RandomVector(&random));
    cams_from_reference.push_back({Eigen::Quaterniond::Identity(), {0.5 * (i % 2), 0, 0}});
    const Rigid3d cam_from_world = cams_from_reference.back() * reference_from_world;
    rays.push_back(DisturbedDirection((cam_from_world * points.back()).normalized(), kNoiseDeg, &random));
  }
  return EstimateRigAbsolutePose(rays, cams_from_reference, points, max_error_rad, /*seed=*/0, 0.5);
}

// COLMAP 4 solves with random numbers that all threads share.
TEST(RigAbsolutePose, IsTheSameWhileOtherThreadsSeed) {
  const std::optional<Rigid3d> expected = EstimatePairPose();
  ASSERT_TRUE(expected.has_value());
  std::atomic<bool> is_done = false;
  std::thread other([&] {
    for (uint32_t seed = 0; !is_done; ++seed) SeedRandomNumbers(seed);
  });
  for (int repetition = 0; repetition < 20; ++repetition) {
    const std::optional<Rigid3d> pose = EstimatePairPose();
    EXPECT_TRUE(pose.has_value() && pose->translation == expected->translation &&
                pose->rotation.coeffs() == expected->rotation.coeffs());
  }
  is_done = true;
  other.join();
}

// Rays of a camera whose principal point is far from the image: 1 - cos(bound) is 0.
TEST(RigAbsolutePose, TinyBoundIsNoError) { EXPECT_NO_THROW(EstimatePairPose(/*max_error_rad=*/1e-9)); }

}  // namespace
}  // namespace lazyloc

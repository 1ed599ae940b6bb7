#include "colmap_lazyloc/bridge/ray_geometry.h"

#include <random>

#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/absolute_pose.h"
#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/bridge/two_view_estimation.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/equirectangular.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

const Camera kSphere{1, kEquirectangularId, 2000, 1000, {2000, 1000}, false};
const Camera kPinhole{2, 1, 800, 600, {500, 500, 400, 300}, true};

// Returns points on all sides of the world's origin.
std::vector<Eigen::Vector3d> PointsAround(int num_points, std::mt19937* random) {
  std::normal_distribution<double> normal;
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < num_points; ++i) {
    const Eigen::Vector3d direction = RandomVector(random).normalized();
    points.push_back((4 + normal(*random) / 2) * direction);
  }
  return points;
}

struct Pair {
  Camera other_camera = kSphere, query_camera = kSphere;
  Rigid3d query_from_other{Eigen::Quaterniond(0.4, 0.3, -0.8, 0.2).normalized(), {0.6, -0.2, 0.5}};
  std::vector<Eigen::Vector2d> other_keypoints, query_keypoints;
  Matches matches;

  // Projects points into both images, the other one at the origin; every outlier_step-th match is random.
  void Observe(int num_points, double noise_px, int outlier_step) {
    std::mt19937 random(1);
    std::normal_distribution<double> noise(0, noise_px);
    std::uniform_real_distribution<double> anywhere(0, 600);
    for (const Eigen::Vector3d& point : PointsAround(num_points, &random)) {
      const auto other = ImageFromCam(other_camera, point),
                 query = ImageFromCam(query_camera, query_from_other * point);
      if (!other || !query) continue;
      const uint32_t index = static_cast<uint32_t>(matches.size());
      other_keypoints.emplace_back(*other + Eigen::Vector2d{noise(random), noise(random)});
      query_keypoints.emplace_back(*query + Eigen::Vector2d{noise(random), noise(random)});
      if (index % outlier_step == 0) query_keypoints.back() = {anywhere(random), anywhere(random)};
      matches.push_back({index, index});
    }
  }
  TwoViewGeometry Estimate(bool is_calibrated = true) const {
    LocalizationProblem problem;
    problem.query_camera = query_camera;
    problem.query_keypoints = query_keypoints;
    ImagePair pair;
    pair.other_camera = other_camera;
    pair.other_keypoints = other_keypoints;
    return EstimateTwoViewGeometry(problem, pair, matches, is_calibrated, /*seed=*/3);
  }
};

TEST(RayGeometry, FindsTheRelativePoseOfSphericalImages) {
  Pair pair;
  pair.Observe(200, 0.5, 4);
  const TwoViewGeometry geometry = pair.Estimate();
  ASSERT_EQ(geometry.config, TwoViewConfig::CALIBRATED);
  EXPECT_GT(geometry.inlier_matches.size(), 140u);
  EXPECT_LT(geometry.inlier_matches.size(), 165u);
  EXPECT_LT(AngularDistanceRad(geometry.query_from_other->rotation, pair.query_from_other.rotation), 0.006);
  EXPECT_LT((geometry.query_from_other->translation - pair.query_from_other.translation.normalized()).norm(), 0.05);
}

TEST(RayGeometry, UncalibratedIsTheSameBecauseASphereHasNoFocalLength) {
  Pair pair;
  pair.Observe(100, 0.5, 5);
  EXPECT_EQ(pair.Estimate(false).inlier_matches.size(), pair.Estimate(true).inlier_matches.size());
}

TEST(RayGeometry, TakesAPinholeImageBesideASphericalOne) {
  Pair pair;
  pair.query_camera = kPinhole;
  pair.Observe(1500, 0.5, 4);
  const TwoViewGeometry geometry = pair.Estimate();
  ASSERT_EQ(geometry.config, TwoViewConfig::CALIBRATED);
  EXPECT_LT(AngularDistanceRad(geometry.query_from_other->rotation, pair.query_from_other.rotation), 0.01);
  EXPECT_GT(geometry.query_from_other->translation.dot(pair.query_from_other.translation.normalized()), 0.99);
}

TEST(RayGeometry, ImagesOfOnePlaceGiveARotationAlone) {
  Pair pair;
  pair.query_from_other.translation.setZero();
  pair.Observe(200, 0.5, 4);
  const TwoViewGeometry geometry = pair.Estimate();
  ASSERT_EQ(geometry.config, TwoViewConfig::PANORAMIC);
  EXPECT_LT(AngularDistanceRad(geometry.query_from_other->rotation, pair.query_from_other.rotation), 0.002);
}

TEST(RayGeometry, RandomMatchesAreDegenerate) {
  Pair pair;
  pair.Observe(40, 0.5, 1);
  EXPECT_EQ(pair.Estimate().config, TwoViewConfig::DEGENERATE);
}

TEST(SphericalAbsolutePose, TakesRaysOfAllDirections) {
  std::mt19937 random(2);
  const std::vector<Eigen::Vector3d> points = PointsAround(100, &random);
  const Rigid3d cam_from_world{Eigen::Quaterniond(0.1, 0.9, 0.2, -0.3).normalized(), {0.5, 0.4, -0.3}};
  std::vector<Eigen::Vector3d> rays;
  for (const Eigen::Vector3d& point : points) rays.push_back((cam_from_world * point).normalized());
  for (size_t i = 0; i < rays.size(); i += 3) rays[i] = -rays[i];  // behind the camera: outliers
  const std::optional<Rigid3d> found = EstimateAbsolutePose(rays, points, 0.002, /*seed=*/1, /*min_inlier_ratio=*/0.3);
  ASSERT_TRUE(found.has_value());
  EXPECT_LT((CamInWorld(*found) - CamInWorld(cam_from_world)).norm(), 1e-3);
  EXPECT_LT(AngularDistanceRad(found->rotation, cam_from_world.rotation), 1e-3);
}

}  // namespace
}  // namespace lazyloc

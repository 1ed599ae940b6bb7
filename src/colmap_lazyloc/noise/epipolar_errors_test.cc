#include "colmap_lazyloc/noise/epipolar_errors.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

constexpr double kFocalLengthPx = 500, kDistance = 6;
using Vector6d = Eigen::Matrix<double, 6, 1>;

// Returns the observation of a pinhole camera at a point in pixels relative to its principal point.
Observation Observe(const Eigen::Vector2d& xy) {
  Observation observation;
  observation.ray_in_cam = (xy / kFocalLengthPx).homogeneous().normalized();
  const Eigen::Vector3d& ray = observation.ray_in_cam;
  observation.px_from_cam << 1, 0, -ray.x() / ray.z(), 0, 1, -ray.y() / ray.z();
  observation.px_from_cam *= kFocalLengthPx / ray.z();
  return observation;
}

// Two cameras side by side that look at points in a cube, and their matches.
struct TwoCameras {
  explicit TwoCameras(double baseline = 1.0, int num_points = 150, double noise_px = 0) {
    cam_from_world = LookAt({0, 0, -kDistance}, {0, 0, 0});
    other_from_world = LookAt({baseline, 0.1 * baseline, -kDistance}, {0.2, 0, 0});
    std::normal_distribution<double> noise(0, 1);
    for (int i = 0; i < num_points; ++i) {
      const Eigen::Vector3d point = RandomVector(&random);
      Eigen::Vector2d xy[2];
      for (const int k : {0, 1}) {
        const Eigen::Vector3d in_cam = (k == 0 ? cam_from_world : other_from_world) * point;
        xy[k] = kFocalLengthPx * in_cam.hnormalized();
        xy[k] += noise_px * Eigen::Vector2d{noise(random), noise(random)};
      }
      observations.push_back({Observe(xy[0]), Observe(xy[1])});
    }
  }

  // Fits the errors of the matches by given poses.
  std::optional<EpipolarFit> Fit(const Rigid3d& first_from_world, const Rigid3d& second_from_world) const {
    std::vector<RayMatch> matches;
    for (const auto& [first, second] : observations) {
      matches.push_back(MakeRayMatch(first_from_world.rotation.conjugate().toRotationMatrix(), first,
                                     second_from_world.rotation.conjugate().toRotationMatrix(), second));
    }
    return FitEpipolarErrors(CamInWorld(second_from_world) - CamInWorld(first_from_world), matches);
  }
  std::optional<EpipolarFit> Fit() const { return Fit(cam_from_world, other_from_world); }

  Random random{7};
  Rigid3d cam_from_world, other_from_world;
  std::vector<std::pair<Observation, Observation>> observations;
};

// Returns the pose whose deviation from it, in pixels, is that of `pose`.
Rigid3d GivenPose(const Rigid3d& pose, const Vector6d& deviation_px) {
  const Eigen::Vector3d turn = deviation_px.head<3>() / kFocalLengthPx;
  const Eigen::Vector3d centre = CamInWorld(pose) - deviation_px.tail<3>() * kDistance / kFocalLengthPx;
  return CamFromWorld((pose.rotation * ExpSO3(turn).conjugate()).normalized(), centre);
}

Vector6d MostLikely(const EpipolarFit& fit) {
  Eigen::Matrix<double, 6, 6> equations = fit.information;
  equations.diagonal().array() += 1e-6;
  return equations.ldlt().solve(fit.rhs);
}

TEST(FitEpipolarErrors, FindsTheDeviationButForTheBaseline) {
  const TwoCameras cameras;
  const Vector6d deviation = (Vector6d() << 1, -2, 1.5, 0.1, -1, 2).finished();
  const Rigid3d given = GivenPose(cameras.other_from_world, deviation);
  const auto fit = cameras.Fit(cameras.cam_from_world, given);
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->scale.focal_length_px, kFocalLengthPx, 0.05 * kFocalLengthPx);
  EXPECT_NEAR(fit->scale.distance, kDistance, 0.1 * kDistance);
  EXPECT_LT(fit->noise_px, 0.25);
  const Eigen::Vector3d along = (CamInWorld(given) - CamInWorld(cameras.cam_from_world)).normalized();
  EXPECT_LT((fit->information.bottomRightCorner<3, 3>() * along).norm(), 1e-6 * fit->information.norm());
  Vector6d difference = MostLikely(*fit) - deviation;
  difference.tail<3>() -= difference.tail<3>().dot(along) * along;
  EXPECT_LT(difference.norm(), 0.3);
}

TEST(FitEpipolarErrors, IsNotLedAstrayByFalseMatches) {
  TwoCameras cameras(1.0, 150, 0.5);
  const auto clean = cameras.Fit();
  for (size_t i = 0; i < 30; ++i) std::swap(cameras.observations[i].first, cameras.observations[i + 60].first);
  const auto fit = cameras.Fit();
  ASSERT_TRUE(clean && fit);
  EXPECT_LT(clean->noise_px, 0.7);
  EXPECT_GT(clean->noise_px, 0.3);
  EXPECT_LT(fit->noise_px, 1.5);
  EXPECT_LT(MostLikely(*fit).head<3>().norm(), 6);
}

TEST(FitEpipolarErrors, ManyMatchesAreNotMoreExactThanTheirCommonErrors) {
  const TwoCameras few(1.0, 2000), many(1.0, 20000);
  const auto fit = few.Fit();
  const auto more = many.Fit();
  ASSERT_TRUE(fit && more);
  EXPECT_LT(more->information.trace(), 1.2 * fit->information.trace());
}

TEST(FitEpipolarErrors, NothingWithoutEvidence) {
  const TwoCameras few(1.0, 20), near(0.1), none(0);
  EXPECT_FALSE(few.Fit());
  EXPECT_FALSE(near.Fit());
  EXPECT_FALSE(none.Fit(none.cam_from_world, none.cam_from_world));
  TwoCameras random;
  for (size_t i = 0; i < random.observations.size(); ++i) {
    random.observations[i].first = random.observations[(7 * i + 3) % random.observations.size()].first;
  }
  EXPECT_FALSE(random.Fit());
}

}  // namespace
}  // namespace lazyloc

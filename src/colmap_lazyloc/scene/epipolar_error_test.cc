#include "colmap_lazyloc/scene/epipolar_error.h"

#include <cmath>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/jacobian_check.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

constexpr double kFocalLengthPx = 500;

// Observes a point from a pinhole camera, with an error in pixels.
Observation Observe(const Eigen::Vector3d& point_in_cam, double error_px = 0) {
  Observation observation;
  const Eigen::Vector3d shifted = point_in_cam / point_in_cam.z() + Eigen::Vector3d(0, error_px / kFocalLengthPx, 0);
  observation.ray_in_cam = shifted.normalized();
  const double scale = kFocalLengthPx * shifted.norm();
  Eigen::Matrix<double, 2, 3> px_from_cam;
  px_from_cam << scale, 0, -scale * shifted.x(), 0, scale, -scale * shifted.y();
  observation.px_from_cam = px_from_cam;
  return observation;
}

class EpipolarErrorTest : public ::testing::Test {
 protected:
  const Rigid3d a_from_b_{Eigen::Quaterniond::Identity(), {-1, 0, 0}};
  const Eigen::Vector3d point_in_b_{0.3, 0.2, 5};
};

TEST_F(EpipolarErrorTest, IsZeroForARightMatch) {
  const EpipolarError error = MeasureEpipolarError(a_from_b_, Observe(a_from_b_ * point_in_b_), Observe(point_in_b_));
  EXPECT_NEAR(error.squared_px, 0, 1e-12);
  EXPECT_TRUE(error.is_in_front);
}

TEST_F(EpipolarErrorTest, IsTheDistanceFromTheLinesOfBothImages) {
  for (const double length : {1.0, 100.0}) {
    const Rigid3d a_from_b{a_from_b_.rotation, length * a_from_b_.translation};
    const EpipolarError error =
        MeasureEpipolarError(a_from_b, Observe(a_from_b_ * point_in_b_, 4), Observe(point_in_b_));
    EXPECT_NEAR(std::sqrt(error.squared_px), 4 / std::sqrt(2), 0.1) << "both images share the error";
  }
}

TEST_F(EpipolarErrorTest, BehindTheImagesItIsTheParallax) {
  const Rigid3d behind{a_from_b_.rotation, -a_from_b_.translation};
  const EpipolarError error = MeasureEpipolarError(behind, Observe(a_from_b_ * point_in_b_), Observe(point_in_b_));
  EXPECT_FALSE(error.is_in_front);
  EXPECT_NEAR(std::sqrt(error.squared_px), kFocalLengthPx / 5 / std::sqrt(2), 3);
}

// Returns the match of a track between two images at given poses.
RayMatch MatchOf(const Track& track, int image1, const Rigid3d& pose1, int image2, const Rigid3d& pose2) {
  return MakeRayMatch(pose1.rotation.conjugate().toRotationMatrix(), track.observations[image1].observation,
                      pose2.rotation.conjugate().toRotationMatrix(), track.observations[image2].observation);
}

class SampsonErrorTest : public ::testing::Test {
 protected:
  SampsonErrorTest() {
    SyntheticTracksOptions options;
    options.noise_px = 0.5;
    scene_ = MakeSyntheticTracks(options);
    pose1_ = CamFromWorld(scene_.posed, 1);
    pose2_ = CamFromWorld(scene_.posed, 0);
  }

  RayMatch Match(const Track& track) const { return MatchOf(track, 1, pose1_, 0, pose2_); }
  Eigen::Vector3d Baseline() const { return CamInWorld(pose2_) - CamInWorld(pose1_); }

  SyntheticTracks scene_;
  Rigid3d pose1_, pose2_;
};

TEST_F(SampsonErrorTest, JacobianIsThatOfFiniteDifferences) {
  pose2_.rotation = ExpSO3({0.02, -0.01, 0.03}) * pose2_.rotation;
  for (int i = 0; i < 10; ++i) {
    RayMatch match = Match(scene_.tracks[i]);
    match.stddev1_rad *= 2;
    Eigen::Matrix<double, 1, 6> jacobian;
    SampsonError(match, Baseline(), &jacobian);
    const auto error = [&](const Eigen::VectorXd& step) -> Eigen::VectorXd {
      RayMatch moved = match;
      const Eigen::Vector3d turn = step.head<3>();
      moved.ray2 = ExpSO3(-turn) * match.ray2;
      return Eigen::VectorXd::Constant(1, SampsonError(moved, Baseline() + step.tail<3>()));
    };
    ExpectJacobian(error, jacobian);
    EXPECT_NEAR(jacobian.tail<3>() * Baseline(), 0, 1e-9 * jacobian.norm()) << "the length of the baseline";
  }
}

// Expects a standard normal error at the true pose, for keypoints with the stated noise.
TEST_F(SampsonErrorTest, CountsStandardDeviations) {
  double sum = 0;
  for (const Track& track : scene_.tracks) sum += std::pow(SampsonError(Match(track), Baseline()) / 0.5, 2);
  const double num_matches = static_cast<double>(scene_.tracks.size());
  EXPECT_NEAR(sum / num_matches, 1, 4 * std::sqrt(2 / num_matches));
}

TEST_F(SampsonErrorTest, WithoutBaselineIsZero) {
  Eigen::Matrix<double, 1, 6> jacobian;
  EXPECT_EQ(SampsonError(Match(scene_.tracks[0]), Eigen::Vector3d::Zero(), &jacobian), 0);
  EXPECT_TRUE(jacobian.isZero());
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/scene/pose_distribution.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

using Matrix = PoseDistribution::Matrix;
using Vector = PoseDistribution::Vector;

class PoseDistributionTest : public ::testing::Test {
 protected:
  Vector RandomTangent() {
    Vector tangent;
    tangent << RandomVector(&random_), RandomVector(&random_);
    return tangent;
  }
  Matrix RandomRoot() {
    Matrix root;
    for (int i = 0; i < 6; ++i) root.row(i) = 1e-3 * RandomTangent().transpose();
    return root;
  }

  Random random_{1};
  const Rigid3d cam_from_world_ = LookAt({1, 2, -8}, {0, 0, 0});
};

// Samples from the covariance itself, which gives each variance to sqrt(2 / 20000) = 1 %.
TEST_F(PoseDistributionTest, SpreadIsThatOfSampledPoses) {
  const Matrix root = RandomRoot();
  const PoseDistribution pose = MakePoseDistribution(cam_from_world_, root * root.transpose());
  const PoseSpread spread = pose.Spread();
  Eigen::Matrix3d sampled = Eigen::Matrix3d::Zero();
  const int num_trials = 20000;
  for (int trial = 0; trial < num_trials; ++trial) {
    const Vector move = root * RandomTangent();
    const Rigid3d moved{ExpSO3(move.head<3>()) * cam_from_world_.rotation,
                        cam_from_world_.translation + move.tail<3>()};
    const Eigen::Vector3d offset = CamInWorld(moved) - CamInWorld(cam_from_world_);
    sampled += offset * offset.transpose() / num_trials;
  }
  EXPECT_LE((sampled - pose.PositionCovariance()).norm(), 0.05 * sampled.norm());
  const Eigen::Vector3d& axis = spread.weakest_direction_in_world;
  EXPECT_NEAR(std::sqrt(axis.dot(sampled * axis)) / spread.position_stddevs[0], 1, 0.03);
  EXPECT_NEAR(std::sqrt(sampled.trace()) / spread.position_stddevs.norm(), 1, 0.03);
  EXPECT_LE((sampled * axis - axis.dot(sampled * axis) * axis).norm(), 0.05 * sampled.norm());
  EXPECT_GE(spread.position_stddevs[1], spread.position_stddevs[2]);
}

TEST_F(PoseDistributionTest, CovarianceGoesBackToAnyCoordinates) {
  const Matrix root = RandomRoot(), covariance = root * root.transpose();
  PoseDistribution pose = MakePoseDistribution(cam_from_world_, covariance);
  EXPECT_LE((pose.CovarianceAt(cam_from_world_.translation) - covariance).norm(), 1e-12 * covariance.norm());
  EXPECT_LE((pose.CovarianceAt(Eigen::Vector3d::Zero()) - pose.Covariance()).norm(), 1e-12 * covariance.norm());
  const Vector by_log_focal = RandomTangent();
  pose.by_log_focal = AroundCamera(cam_from_world_) * by_log_focal;
  pose.log_focal_variance = 2;
  const Matrix sum = covariance + 2 * by_log_focal * by_log_focal.transpose();
  EXPECT_LE((pose.CovarianceAt(cam_from_world_.translation) - sum).norm(), 1e-12 * sum.norm());
}

TEST_F(PoseDistributionTest, IndependentErrorsKeepApart) {
  const Eigen::Matrix3d rotation = Eigen::Vector3d(1e-6, 2e-6, 3e-6).asDiagonal();
  const Eigen::Matrix3d position = Eigen::Vector3d(0.1, 0.3, 0.2).asDiagonal();
  const PoseDistribution pose = MakePoseDistribution(cam_from_world_, rotation, position);
  EXPECT_LE((pose.RotationCovariance() - rotation).norm(), 1e-18);
  EXPECT_LE((pose.PositionCovariance() - position).norm(), 1e-12);
  EXPECT_NEAR(pose.Spread().rotation_stddev_rad, std::sqrt(3e-6), 1e-9);
  EXPECT_NEAR(pose.Spread().position_stddevs[0], std::sqrt(0.3), 1e-9);
  EXPECT_LE((pose.Spread().weakest_direction_in_world - Eigen::Vector3d::UnitY()).norm(), 1e-9);
  const PoseDistribution again = MakePoseDistribution(cam_from_world_, pose.CovarianceAt(cam_from_world_.translation));
  EXPECT_LE((again.of_images - pose.of_images).norm(), 1e-9 * pose.of_images.norm());
}

// A measurement of the camera's step, as certain as the pose, halves the covariance and moves the pose halfway.
TEST_F(PoseDistributionTest, UpdateTakesTheMostProbablePose) {
  constexpr double kStddev = 0.01;
  PoseDistribution pose = MakePoseDistribution(cam_from_world_, 1e-6 * Eigen::Matrix3d::Identity(),
                                               kStddev * kStddev * Eigen::Matrix3d::Identity());
  pose.by_log_focal = RandomTangent();
  pose.log_focal_variance = 1e-4;
  const PoseDistribution before = pose;
  const Eigen::Vector3d measured_step(0.02, 0, -0.01);  // in the camera's axes
  Vector errors = Vector::Zero();
  Matrix jacobian = Matrix::Zero();
  errors.head<3>() = -measured_step / kStddev;
  jacobian.topRightCorner<3, 3>() = Eigen::Matrix3d::Identity() / kStddev;
  pose.Update(errors, jacobian);
  const Eigen::Vector3d moved =
      cam_from_world_.rotation * (CamInWorld(pose.cam_from_world) - CamInWorld(cam_from_world_));
  EXPECT_LE((moved + measured_step / 2).norm(), 1e-9);
  EXPECT_LE(AngularDistanceRad(pose.cam_from_world.rotation, cam_from_world_.rotation), 1e-12);
  EXPECT_NEAR(pose.of_images(4, 4), kStddev * kStddev / 2, 1e-12);
  EXPECT_NEAR(pose.of_images(1, 1), 1e-6, 1e-12);
  EXPECT_LE((pose.by_log_focal.tail<3>() - before.by_log_focal.tail<3>() / 2).norm(), 1e-9);
  EXPECT_LE((pose.by_log_focal.head<3>() - before.by_log_focal.head<3>()).norm(), 1e-12);
}

}  // namespace
}  // namespace lazyloc

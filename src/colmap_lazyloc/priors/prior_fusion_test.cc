#include "colmap_lazyloc/priors/prior_fusion.h"

#include <gmock/gmock.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/lazy_localizer.h"
#include "colmap_lazyloc/scene/pose_distribution.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;

// Returns options with the default noise model of database poses.
LocalizerOptions WithExactFocalLength() {
  LocalizerOptions options;
  options.focal_length_stddev_ratio = 0;
  return options;
}

SyntheticScene MakeScene(const Eigen::Vector3d& origin = Eigen::Vector3d::Zero()) {
  SyntheticSceneOptions options;
  options.num_database_images = 6;
  options.pixel_noise_px = 0.5;
  options.origin = origin;
  return MakeSyntheticScene(options);
}

Eigen::Matrix3d PositionCovariance(const LocalizationResult& result) {
  return MakePoseDistribution(result.cam_from_world, result.covariance).PositionCovariance();
}

// With the default noise model, whose covariance has parts that no adjustment knows, a position as certain as the pose
// halves its covariance and draws it half the way.
TEST(PriorFusion, PositionAsCertainAsThePoseHalvesItsCovariance) {
  for (const Eigen::Vector3d& origin : {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(500000, 5400000, 300)}) {
    SyntheticScene scene = MakeScene(origin);
    const LocalizationResult without = LocalizeQuery(scene.problem, WithExactFocalLength());
    ASSERT_TRUE(HasPose(without.status)) << without.reason;
    const Eigen::Matrix3d covariance = PositionCovariance(without);
    const Eigen::Vector3d offset = Eigen::Vector3d(0.5, -0.7, 0.6) * std::sqrt(covariance.trace() / 3);
    scene.problem.prior.position = {CamInWorld(without.cam_from_world) + offset, covariance};
    const LocalizationResult with = LocalizeQuery(scene.problem, WithExactFocalLength());
    EXPECT_EQ(with.priors.position->verdict, PriorVerdict::USED);
    EXPECT_EQ(with.priors.position->fixes, PriorRole::NOTHING);
    const Eigen::Vector3d moved = CamInWorld(with.cam_from_world) - CamInWorld(without.cam_from_world);
    EXPECT_LE((moved - offset / 2).norm(), 1e-3 * offset.norm());
    EXPECT_LE((PositionCovariance(with) - covariance / 2).norm(), 1e-3 * covariance.norm());
    EXPECT_NEAR(with.spread.position_stddevs[0], without.spread.position_stddevs[0] / std::sqrt(2),
                1e-3 * without.spread.position_stddevs[0]);
  }
}

// The rotation follows the position as far as their errors are correlated: the fused pose is the most probable one.
TEST(PriorFusion, PoseIsTheMostProbableOne) {
  SyntheticScene scene = MakeScene();
  const LocalizationResult without = LocalizeQuery(scene.problem, WithExactFocalLength());
  ASSERT_TRUE(HasPose(without.status)) << without.reason;
  const double stddev = without.spread.position_stddevs[0];
  const PositionPrior position{CamInWorld(without.cam_from_world) + Eigen::Vector3d(1, -0.5, 0.3) * stddev,
                               stddev * stddev * Eigen::Matrix3d::Identity()};
  const GravityPrior gravity{
      Eigen::Quaterniond(Eigen::AngleAxisd(without.spread.rotation_stddev_rad, Eigen::Vector3d(0.6, 0, 0.8))) *
          without.cam_from_world.rotation * Eigen::Vector3d(0, 0, -1),
      Eigen::Vector3d(0, 0, -1), without.spread.rotation_stddev_rad};
  scene.problem.prior = {position, gravity};
  const LocalizationResult with = LocalizeQuery(scene.problem, WithExactFocalLength());
  ASSERT_EQ(with.priors.position->verdict, PriorVerdict::USED);
  ASSERT_EQ(with.priors.gravity->verdict, PriorVerdict::USED);
  const Matrix6 information = without.covariance.inverse();
  const auto squared_sigmas = [&](const Rigid3d& pose) {
    Eigen::Matrix<double, 6, 1> tangent;
    tangent << LogSO3(pose.rotation * without.cam_from_world.rotation.conjugate()),
        pose.translation - without.cam_from_world.translation;
    const Eigen::Vector3d offset = CamInWorld(pose) - position.position;
    const double angle_rad = AngleBetweenRad(pose.rotation * gravity.down_in_world, gravity.down_in_cam);
    return tangent.dot(information * tangent) + offset.squaredNorm() / (stddev * stddev) +
           std::pow(angle_rad / gravity.stddev_rad, 2);
  };
  const double least = squared_sigmas(with.cam_from_world);
  for (int i = 0; i < 6; ++i) {
    for (const double sign : {-1.0, 1.0}) {
      const Eigen::Matrix<double, 6, 1> step =
          0.3 * sign * std::sqrt(without.covariance(i, i)) * Eigen::Matrix<double, 6, 1>::Unit(i);
      const Rigid3d near = {ExpSO3(step.head<3>()) * with.cam_from_world.rotation,
                            with.cam_from_world.translation + step.tail<3>()};
      EXPECT_GT(squared_sigmas(near), least);
    }
  }
}

// A position as certain as the whole pose is hardly weighed against the focal length, but its covariance is kept.
TEST(PriorFusion, ErrorsOfTheFocalLengthAreLeftToTheCovariance) {
  SyntheticScene scene = MakeScene();
  const LocalizationResult exact = LocalizeQuery(scene.problem, WithExactFocalLength());
  LocalizerOptions options;
  options.focal_length_stddev_ratio = 0.1;
  const LocalizationResult without = LocalizeQuery(scene.problem, options);
  ASSERT_TRUE(HasPose(without.status)) << without.reason;
  const double stddev = without.spread.position_stddevs[0];
  ASSERT_GT(stddev, 2 * exact.spread.position_stddevs[0]);
  scene.problem.prior.position = {CamInWorld(without.cam_from_world) + Eigen::Vector3d(stddev, stddev, stddev),
                                  stddev * stddev * Eigen::Matrix3d::Identity()};
  const LocalizationResult with = LocalizeQuery(scene.problem, options);
  EXPECT_EQ(with.priors.position->verdict, PriorVerdict::USED);
  EXPECT_LE(PositionError(with.cam_from_world, without.cam_from_world), exact.spread.position_stddevs[0]);
  EXPECT_LE(with.spread.position_stddevs[0], without.spread.position_stddevs[0]);
  EXPECT_GT(with.spread.position_stddevs[0], 0.8 * stddev);
}

// Tells poses apart whose priors adjustment uses.
TEST(PriorFusion, RigsAndUnknownFocalLengthsAreLeftToAdjustment) {
  Layout layout;
  layout.num_queries = 3;
  layout.queries_of_frame = {{0}, {1, 2}};
  layout.given.images.resize(3);
  layout.given.images[0].frame = 0;
  layout.given.images[1].frame = layout.given.images[2].frame = 1;
  PosedImages posed = layout.given;
  EXPECT_TRUE(IsFused(layout, posed, 0));
  EXPECT_FALSE(IsFused(layout, posed, 1));
  posed.images[0].log_focal_factor = 0;
  EXPECT_FALSE(IsFused(layout, posed, 0));
}

}  // namespace
}  // namespace lazyloc

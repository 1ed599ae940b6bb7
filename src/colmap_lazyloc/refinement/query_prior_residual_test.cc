#include "colmap_lazyloc/refinement/query_prior_residual.h"

#include <cmath>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/testing/jacobian_check.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

struct Poses {
  Rigid3d cam_from_frame, frame_from_world;

  Rigid3d CamFromFrame(double log_factor) const {
    return {cam_from_frame.rotation, std::exp(log_factor) * cam_from_frame.translation};
  }
  Rigid3d FrameFromWorld(const Eigen::VectorXd& move) const {
    const Eigen::Quaterniond rotation = ExpSO3(Eigen::Vector3d(move.head<3>())) * frame_from_world.rotation;
    return {rotation, frame_from_world.translation + move.segment<3>(3)};
  }
};

Poses RandomPoses() {
  Random random(3);
  return {{RandomRotation(&random), RandomVector(&random)}, {RandomRotation(&random), RandomVector(&random)}};
}

TEST(QueryPriorResidual, JacobianOfThePositionIsTheDerivative) {
  const Poses poses = RandomPoses();
  PositionPrior prior{{1, 2, 3}, Eigen::Vector3d(0.1, 0.4, 2).asDiagonal()};
  prior.covariance(0, 1) = prior.covariance(1, 0) = 0.1;
  const auto error = [&](const Eigen::VectorXd& move) -> Eigen::VectorXd {
    return EvaluatePositionPrior(prior, poses.CamFromFrame(move[6]), poses.FrameFromWorld(move)).error;
  };
  const auto residual = EvaluatePositionPrior(prior, poses.cam_from_frame, poses.frame_from_world);
  ExpectJacobian(error, residual.jacobian);
  const Eigen::Vector3d deviation = CamInWorld(poses.cam_from_frame * poses.frame_from_world) - prior.position;
  EXPECT_NEAR(residual.error.squaredNorm(), deviation.dot(prior.covariance.inverse() * deviation), 1e-9);
}

TEST(QueryPriorResidual, JacobianOfGravityIsTheDerivative) {
  const Poses poses = RandomPoses();
  const Rigid3d cam_from_world = poses.cam_from_frame * poses.frame_from_world;
  Random random(4);
  const Eigen::Vector3d down_in_world(0, 0, -1);
  const GravityPrior prior{DisturbedDirection(cam_from_world.rotation * down_in_world, 2, &random), down_in_world,
                           0.02};
  const auto error = [&](const Eigen::VectorXd& move) -> Eigen::VectorXd {
    return EvaluateGravityPrior(prior, poses.CamFromFrame(move[6]), poses.FrameFromWorld(move)).error;
  };
  const auto residual = EvaluateGravityPrior(prior, poses.cam_from_frame, poses.frame_from_world);
  ExpectJacobian(error, residual.jacobian);
  EXPECT_NEAR(residual.error.norm(), std::sin(DegToRad(2)) / 0.02, 1e-6);
}

// Adjusts a query that one constant database image observes, whose distance nothing but a prior fixes.
TEST(QueryPriorResidual, PositionPriorFixesADistance) {
  SyntheticTracksOptions options;
  options.num_database = 1;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  const Eigen::Vector3d centre = CamInWorld(CamFromWorld(scene.posed, 0));
  const Eigen::Vector3d from = CamInWorld(CamFromWorld(scene.posed, 1));
  const Eigen::Vector3d direction = (centre - from).normalized();
  PositionPrior prior{centre + 0.3 * direction, 0.04 * Eigen::Matrix3d::Identity()};
  scene.posed.query_priors = {{0, {prior, std::nullopt}}};
  BundleAdjustmentOptions adjustment;
  adjustment.convergence_sigma = 1e-6;
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, adjustment);
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  EXPECT_LE((CamInWorld(CamFromWorld(result.posed, 0)) - prior.position).norm(), 1e-5);
}

}  // namespace
}  // namespace lazyloc

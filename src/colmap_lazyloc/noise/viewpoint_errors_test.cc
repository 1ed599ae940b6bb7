#include "colmap_lazyloc/noise/viewpoint_errors.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/noise/database_priors.h"
#include "colmap_lazyloc/refinement/pose_prior.h"
#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

constexpr double kDistance = 10;

// A query frame of two images, two database frames at their viewpoints, and a third beyond.
struct Scene {
  Layout layout;
  PosedImages adjusted;

  Scene() {
    layout.num_queries = 2;
    layout.num_query_frames = 1;
    layout.queries_of_frame = {{0, 1}};
    adjusted.images.resize(5);
    adjusted.frames.resize(4);
    std::vector<Rigid3d> poses;
    for (int i = 0; i < 3; ++i) {
      poses.push_back({Eigen::Quaterniond::Identity(), {-i * 1.0, 0, 0}});
      Frame& frame = adjusted.frames[i + 1];
      frame.frame_from_world = poses.back();
      frame.is_database = true;
      frame.prior = MakePosePrior(poses.back(), 1, {500, kDistance});
      adjusted.images[i + 2].frame = i + 1;
    }
    for (const int image : {0, 1}) adjusted.images[image].frame = 0;
    adjusted.images[1].cam_from_frame = poses[1];
    const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(3, 3);
    adjusted.prior_groups = {{{1, 2, 3},
                              {{ViewpointErrorShape(poses, poses[0], kDistance), 1},
                               {identity, 1e-6, PosePart::ROTATION},
                               {identity, 1e-6, PosePart::POSITION}}}};
    layout.given = adjusted;
  }
  Rigid3d Moved() const {
    const PosedImages reported = RelativeToGivenDatabase(layout, adjusted);
    EXPECT_TRUE(HasFrameAxes(reported.images[0])) << "corrections are relative to the first image";
    return CamFromWorld(reported, 1);
  }
};

TEST(RelativeToGivenDatabase, AnImageMovesBackAsTheDatabaseFrameAtItsViewpoint) {
  Scene scene;
  Rigid3d& corrected = scene.adjusted.frames[2].frame_from_world;
  corrected = CamFromWorld(corrected.rotation * ExpSO3({0.001, 0, 0.002}),
                           CamInWorld(corrected) + Eigen::Vector3d(0, 0.02, -0.01));
  const Rigid3d expected(CamFromWorld(ExpSO3({-0.001, 0, -0.002}), Eigen::Vector3d(1, -0.02, 0.01)));
  EXPECT_LT(AngularDistanceRad(scene.Moved().rotation, expected.rotation), 1e-5);
  EXPECT_LT((CamInWorld(scene.Moved()) - CamInWorld(expected)).norm(), 1e-4);
}

TEST(PredictErrors, VarianceGrowsWithTheDistanceFromTheDatabaseFrames) {
  const Scene scene;
  const std::vector<Rigid3d> viewpoints = {{Eigen::Quaterniond::Identity(), {-1, 0, 0}},
                                           {Eigen::Quaterniond::Identity(), {-1, 0.5, 0}},
                                           {Eigen::Quaterniond::Identity(), {-1, 1, 0}}};
  const PredictedErrors predicted = PredictErrors(scene.adjusted, scene.adjusted.prior_groups[0],
                                                  scene.adjusted.frames[0].frame_from_world, viewpoints);
  EXPECT_TRUE(predicted.by_position.row(0).isApprox(Eigen::RowVector3d(0, 1, 0), 1e-4)) << "that of its database frame";
  EXPECT_NEAR(predicted.position_variances[0], 0, 1e-5);
  // A distance of 0.5 is 0.05 times the scene's, where the variance between two viewpoints is (0.05 / 0.2)^1.5.
  EXPECT_GT(predicted.rotation_variances[1], 0.05);
  EXPECT_LT(predicted.rotation_variances[1], 0.125);
  EXPECT_GT(predicted.rotation_variances[2], 1.5 * predicted.rotation_variances[1]);
}

TEST(RelativeToGivenDatabase, IndependentErrorsStayWithTheirDatabaseFrame) {
  Scene scene;
  Rigid3d& corrected = scene.adjusted.frames[2].frame_from_world;
  corrected = CamFromWorld(corrected.rotation * ExpSO3({0.001, 0, 0.002}),
                           CamInWorld(corrected) + Eigen::Vector3d(0, 0.02, -0.01));
  const Scene both = scene;
  scene.adjusted.prior_groups[0].components[1].variance = 1e6;  // of rotations
  EXPECT_LT(AngularDistanceRad(scene.Moved().rotation, CamFromWorld(both.adjusted, 1).rotation), 1e-5);
  EXPECT_LT((CamInWorld(scene.Moved()) - CamInWorld(both.Moved())).norm(), 1e-5);
}

TEST(RelativeToGivenDatabase, StatedErrorsAndCalibrationsOfTheDatabaseLeaveImages) {
  Scene scene;
  scene.adjusted.frames[2].frame_from_world.translation.y() += 0.02;
  const Rigid3d adjusted = CamFromWorld(scene.adjusted, 1);
  EXPECT_NE(scene.Moved().translation, adjusted.translation);
  Scene stated = scene;
  stated.adjusted.prior_groups[0].components.resize(1);
  EXPECT_EQ(stated.Moved().translation, adjusted.translation);
  scene.adjusted.images[1].calibration = 0;
  scene.adjusted.calibrations.resize(1);
  scene.adjusted.calibrations[0].is_stated_by_database = true;
  EXPECT_EQ(scene.Moved().translation, adjusted.translation);
}

TEST(RelativeToGivenDatabase, RestoresDatabasePosesAndTheirCalibration) {
  for (const bool has_rigs : {true, false}) {
    SyntheticGroupOptions options;
    options.num_database_images = 6;
    options.has_database_rigs = has_rigs;
    const Layout layout = MakeLayout(MakeSyntheticGroup(options).group);
    PosedImages adjusted = layout.given;
    for (Frame& frame : adjusted.frames) frame.frame_from_world.translation.x() += 1;
    for (Image& image : adjusted.images) image.cam_from_frame.translation.y() += 1;
    const PosedImages reported = RelativeToGivenDatabase(layout, adjusted);
    ExpectSameBits(reported.frames[0].frame_from_world, adjusted.frames[0].frame_from_world);
    ExpectSameBits(reported.images[1].cam_from_frame, (has_rigs ? layout.given : adjusted).images[1].cam_from_frame);
    ExpectSameDatabasePoses(reported, layout.given);
  }
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/noise/database_priors.h"

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

Rigid3d PoseAt(const Eigen::Vector3d& centre, double angle_rad) {
  return CamFromWorld(ExpSO3(Eigen::Vector3d(0, angle_rad, 0)), centre);
}

TEST(ViewpointErrorShape, GrowsWithTheDistanceOfViewpoints) {
  const Rigid3d query = PoseAt({0, 0, 0}, 0);
  const Eigen::MatrixXd shape =
      ViewpointErrorShape({PoseAt({0.2, 0, 0}, 0), PoseAt({0.8, 0, 0}, 0), PoseAt({0, 0, 0}, 0.2)}, query, 1);
  EXPECT_NEAR(shape(0, 0), 1, 1e-12);
  EXPECT_NEAR(shape(1, 1), 8, 1e-12) << "distance times four, to the power of 1.5";
  EXPECT_NEAR(shape(2, 2), 1, 0.01) << "an angle";
  EXPECT_NEAR(ViewpointErrorShape({PoseAt({0.4, 0, 0}, 0)}, query, 2)(0, 0), 1, 1e-12) << "in a scene twice as far";
}

TEST(ViewpointErrorShape, CameraOnItsSideIsAtTheSameViewpoint) {
  const Rigid3d query = PoseAt({0, 0, 0}, 0.1), frame = PoseAt({0.3, 0, 0}, -0.1);
  const auto shape = [&](const Rigid3d& of_query) { return ViewpointErrorShape({frame}, of_query, 1)(0, 0); };
  const Rigid3d on_its_side = CamFromWorld(ExpSO3(Eigen::Vector3d(0, 0, M_PI / 2)) * query.rotation, CamInWorld(query));
  EXPECT_NEAR(shape(on_its_side), shape(query), 1e-12);
}

TEST(ViewpointErrorShape, FramesOnOneSideErrAlike) {
  const Rigid3d query = PoseAt({0, 0, 0}, 0);
  const Eigen::MatrixXd shape =
      ViewpointErrorShape({PoseAt({0.4, 0, 0}, 0), PoseAt({0.41, 0, 0}, 0), PoseAt({-0.4, 0, 0}, 0)}, query, 1);
  EXPECT_GT(shape(0, 1), 0.95 * shape(0, 0));
  EXPECT_LT(shape(0, 2), 0) << "errors that change steadily have opposite signs on the two sides";
}

TEST(ViewpointErrorShape, IsACovarianceForAllAngles) {
  Random random(2);
  std::vector<Rigid3d> frames;
  for (int i = 0; i < 40; ++i) {
    const Eigen::Quaterniond rotation = ExpSO3(2 * RandomVector(&random));
    frames.push_back(CamFromWorld(rotation, 3 * RandomVector(&random)));
  }
  const Eigen::MatrixXd shape = ViewpointErrorShape(frames, PoseAt({0, 0, 0}, 0), 1);
  const Eigen::VectorXd values = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(shape).eigenvalues();
  EXPECT_GT(values.minCoeff(), 0);
}

SyntheticGroupOptions TwoFrames() {
  SyntheticGroupOptions options;
  options.num_frames = 2;
  options.num_sensors = 1;
  options.num_database_images = 6;
  options.has_query_pairs = false;
  return options;
}

TEST(DatabasePriors, EachQueryFrameHasItsOwnGroup) {
  StageInput input = MakeStageInput(MakeSyntheticGroup(TwoFrames()));
  const DatabasePriors priors(input.layout, {});
  ASSERT_TRUE(priors.HavePriors());
  ASSERT_TRUE(priors.AreEstimated());
  priors.Set(MeasureFrameScales(input.truth, input.tracks), &input.truth);
  ASSERT_EQ(input.truth.prior_groups.size(), 2u);
  for (int frame = 0; frame < 2; ++frame) {
    const PriorGroup& group = input.truth.prior_groups[frame];
    EXPECT_EQ(group.frames, input.layout.database_frames_of_frame[frame]);
    ASSERT_EQ(group.components.size(), 3u);
    EXPECT_DOUBLE_EQ(group.components[0].variance, 0.7 * 0.7);
    for (const int i : group.frames) EXPECT_TRUE(input.truth.frames[i].prior);
  }
}

TEST(DatabasePriors, AsStated) {
  StageInput input = MakeStageInput(MakeSyntheticGroup(TwoFrames()));
  LocalizerOptions options;
  options.database_pose_stddev_deg = 0.5;
  options.database_pose_stddev_length = 0.02;
  const DatabasePriors priors(input.layout, options);
  EXPECT_FALSE(priors.AreEstimated());
  priors.Set(MeasureFrameScales(input.truth, input.tracks), &input.truth);
  const PriorGroup& group = input.truth.prior_groups[0];
  ASSERT_EQ(group.components.size(), 1u);
  EXPECT_TRUE(group.components[0].shape.isIdentity(0)) << "stated deviations are independent";
  EXPECT_NEAR(input.truth.frames[group.frames[0]].prior->rotation_stddev_rad, DegToRad(0.5), 1e-12);
  EXPECT_EQ(input.truth.frames[group.frames[0]].prior->position_stddev, 0.02);
}

TEST(DatabasePriors, ExactPosesHaveNone) {
  StageInput input = MakeStageInput(MakeSyntheticGroup(TwoFrames()));
  LocalizerOptions options;
  options.database_pose_stddev_deg = options.database_pose_stddev_length = 0;
  const DatabasePriors priors(input.layout, options);
  EXPECT_FALSE(priors.HavePriors());
  priors.Set(MeasureFrameScales(input.truth, input.tracks), &input.truth);
  EXPECT_TRUE(input.truth.prior_groups.empty());
}

TEST(DatabasePriors, RememberTheVarianceFactorOfStatedPosesToo) {
  const StageInput input = MakeStageInput(MakeSyntheticGroup(TwoFrames()));
  LocalizerOptions options;
  options.database_pose_stddev_deg = options.database_pose_stddev_length = 0;
  DatabasePriors priors(input.layout, options);
  EXPECT_EQ(priors.ImageVarianceFactor(), 1);
  priors.Estimate({}, 0.25);
  EXPECT_EQ(priors.ImageVarianceFactor(), 0.25) << "calibrations have estimated errors even so";
  priors.Estimate({}, 0);
  EXPECT_GT(priors.ImageVarianceFactor(), 0);
}

// Returns the group of the first query frame after images have found these deviations of all its frames, in pixels.
PriorGroup GroupAfter(double deviation_px) {
  StageInput input = MakeStageInput(MakeSyntheticGroup(TwoFrames()));
  DatabasePriors priors(input.layout, {});
  const std::vector<FrameScale> scales = MeasureFrameScales(input.truth, input.tracks);
  priors.Set(scales, &input.truth);
  BundleAdjustmentResult adjustment;
  adjustment.posed = input.truth;
  Random random(3);
  for (const PriorGroup& group : input.truth.prior_groups) {
    const auto size = static_cast<Eigen::Index>(group.frames.size());
    Eigen::MatrixXd deviations(size, 6);
    for (Eigen::Index i = 0; i < size; ++i) {
      deviations.row(i) << RandomVector(&random).transpose(), RandomVector(&random).transpose();
    }
    adjustment.prior_fits.push_back({deviation_px * deviations, 1e4 * Eigen::MatrixXd::Identity(6 * size, 6 * size)});
  }
  priors.Estimate(adjustment, 1);
  priors.Set(scales, &input.truth);
  return input.truth.prior_groups[0];
}

TEST(DatabasePriors, ExactDatabasesAreFound) {
  const PriorGroup exact = GroupAfter(0.01);  // the noise of the images
  EXPECT_GT(exact.exact_probability, 0.99);
  for (const VarianceComponent& component : exact.components) EXPECT_LT(component.variance, 1e-3);
  const PriorGroup others = GroupAfter(0.5);
  EXPECT_LT(others.exact_probability, 1e-6);
  EXPECT_GT(others.components[0].variance + others.components[2].variance, 0.1);
}

TEST(DatabasePriors, CovarianceAllowsForMoreThanTheEstimate) {
  const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(1, 1);
  const PriorGroup stated{{1}, {{one, 4}}};
  const PriorFit fit{Eigen::MatrixXd::Zero(1, 6), Eigen::MatrixXd::Zero(6, 6)};
  EXPECT_NEAR(VariancesForCovariance(stated, fit, 1)[0], 1, 1e-6) << "as stated, because nothing contradicts it";
  const PriorGroup estimated{{1}, {{one, 4}, {one, 1e-6, PosePart::ROTATION}, {one, 1e-6, PosePart::POSITION}}};
  for (const double factor : {1.0, 0.25}) {
    const std::vector<double> variances = VariancesForCovariance(estimated, fit, factor);
    EXPECT_NEAR(variances[0], 4 * factor + 0.04, 1e-9);
    EXPECT_GE(variances[1], 0.04);
    EXPECT_GE(variances[2], 0.04);
  }
  PriorGroup exact = estimated;
  exact.exact_probability = 1;
  EXPECT_NEAR(VariancesForCovariance(exact, fit, 1)[0], 4, 1e-9) << "nothing that images of an exact database share";
}

}  // namespace
}  // namespace lazyloc

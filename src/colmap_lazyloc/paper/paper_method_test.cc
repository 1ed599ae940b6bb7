#include "colmap_lazyloc/paper/paper_method.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

// A single query with what the stages before have found.
struct Input {
  SyntheticGroup scene;
  StageInput stages;
  PairEstimates estimates;

  PaperPose Localize() const {
    StageTimer::Seconds seconds;
    return LocalizeByPaper(scene.group, stages.layout, estimates, {}, &seconds);
  }
};

Input MakeInput(SyntheticGroupOptions options) {
  options.num_sensors = 1;
  Input input;
  input.scene = MakeSyntheticGroup(options);
  input.stages = MakeStageInput(input.scene);
  input.estimates.pairs = input.stages.pairs;
  return input;
}

TEST(LocalizeByPaper, NoiseFreeIsExact) {
  const Input input = MakeInput({});
  const PaperPose pose = input.Localize();
  ExpectNear(pose.refined.adjustment.posed, input.stages.truth, 1e-6, 1e-5);
  EXPECT_EQ(pose.averaged.pairs.size(), input.stages.pairs.size());
  EXPECT_EQ(pose.refined.adjustment.tracks.size(), input.stages.tracks.size());
}

// Uses 150 points in eight images at a distance of about 8: the noise moves the position by about 0.003. Allows five
// times as much.
TEST(LocalizeByPaper, NoiseIsAveraged) {
  SyntheticGroupOptions options;
  options.pixel_noise_px = 1;
  options.outlier_match_ratio = 0.1;
  for (options.seed = 0; options.seed < 5; ++options.seed) {
    const Input input = MakeInput(options);
    ExpectNear(input.Localize().refined.adjustment.posed, input.stages.truth, 0.02, 0.2);
  }
}

TEST(LocalizeByPaper, KeepsDatabasePosesBitwise) {
  SyntheticGroupOptions options;
  options.pixel_noise_px = 1;
  const Input input = MakeInput(options);
  ExpectSameDatabasePoses(input.Localize().refined.adjustment.posed, input.stages.layout.given);
}

TEST(LocalizeByPaper, ErrorsAreAsLargeAsTheCovarianceStates) {
  SyntheticGroupOptions options;
  options.pixel_noise_px = 1;
  double sum = 0;
  const int num_queries = 20;
  for (options.seed = 0; options.seed < num_queries; ++options.seed) {
    const Input input = MakeInput(options);
    const Refined refined = input.Localize().refined;
    const Rigid3d pose = CamFromWorld(refined.adjustment.posed, 0), truth = CamFromWorld(input.stages.truth, 0);
    Eigen::Matrix<double, 6, 1> error;
    error << LogSO3(pose.rotation * truth.rotation.conjugate()), pose.translation - truth.translation;
    sum += error.dot((refined.variance_factor * refined.adjustment.image_covariances[0]).ldlt().solve(error));
  }
  EXPECT_GT(sum / num_queries, 3);  // 6 are expected, with a standard deviation of 0.8
  EXPECT_LT(sum / num_queries, 10);
}

TEST(LocalizeByPaper, PairsWithAnotherRotationAreNotUsed) {
  SyntheticGroupOptions options;
  Input input = MakeInput(options);
  Random random(1);
  Eigen::Quaterniond& rotation = input.estimates.pairs.front().query_from_other.rotation;
  rotation = Disturbed(rotation, 7, &random);  // its matches still fit, for which the default method keeps it
  const PaperPose pose = input.Localize();
  EXPECT_EQ(pose.averaged.pairs.size(), input.stages.pairs.size() - 1);
  EXPECT_EQ(pose.averaged.directions.size(), pose.averaged.pairs.size());
  ExpectNear(pose.refined.adjustment.posed, input.stages.truth, 1e-6, 1e-5);
}

// Turns a database image after its relative pose was found, so that its observations are off by about 9 px.
TEST(LocalizeByPaper, ObservationsThatDoNotFitAreRemovedAndTheirTracksStay) {
  Input input = MakeInput({});
  const int image = input.stages.pairs.front().other;
  Rigid3d& pose = input.stages.layout.given.frames[input.stages.layout.FrameOf(image)].frame_from_world;
  pose = CamFromWorld(Eigen::AngleAxisd(DegToRad(1), Eigen::Vector3d::UnitY()) * pose.rotation, CamInWorld(pose));
  const Refined refined = input.Localize().refined;
  ExpectNear(refined.adjustment.posed, input.stages.truth, 0.05, 1.1);
  EXPECT_EQ(refined.adjustment.tracks.size(), input.stages.tracks.size());
  size_t num_kept = 0;
  for (const Track& track : refined.adjustment.tracks) {
    for (const TrackObservation& element : track.observations) num_kept += element.image == image;
  }
  EXPECT_LT(num_kept, input.stages.tracks.size() / 4);
}

TEST(LocalizeByPaper, ContradictingPairsAreAFailure) {
  SyntheticGroupOptions options;
  options.outlier_pair_ratio = 1;
  const Input input = MakeInput(options);
  EXPECT_EQ(FailureOf([&] { input.Localize(); }).cause, QueryStatus::INCONSISTENT_ROTATIONS);
}

TEST(AdjustByPaper, TooFewTracksAreAFailure) {
  const Input input = MakeInput({});
  Averaged averaged{input.stages.truth, {}, {}, {}};
  StageTimer::Seconds seconds;
  const Failure failure = FailureOf([&] { AdjustByPaper(input.scene.group, input.stages.layout, averaged, &seconds); });
  EXPECT_EQ(failure.cause, QueryStatus::TOO_FEW_TRACKS);
  EXPECT_EQ(failure.reason, "0 of 0 tracks can be triangulated; 6 are needed");
}

}  // namespace
}  // namespace lazyloc

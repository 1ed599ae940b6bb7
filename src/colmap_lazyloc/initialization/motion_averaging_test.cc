#include "colmap_lazyloc/initialization/motion_averaging.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

Averaged Average(const StageInput& input) {
  StageTimer::Seconds seconds;
  return AverageMotion(input.layout, input.pairs, {}, &seconds);
}

Failure ThrownBy(const StageInput& input) {
  return FailureOf([&] { Average(input); });
}

SyntheticGroupOptions Group(int num_frames, int num_sensors) {
  SyntheticGroupOptions options;
  options.num_frames = num_frames;
  options.num_sensors = num_sensors;
  options.num_points = 60;
  return options;
}

struct GroupSize {
  int num_frames, num_sensors;
};

class GroupsToAverage : public testing::TestWithParam<GroupSize> {};

TEST_P(GroupsToAverage, NoiseFreeIsExact) {
  SyntheticGroupOptions options = Group(GetParam().num_frames, GetParam().num_sensors);
  for (options.seed = 0; options.seed < 3; ++options.seed) {
    const StageInput input = MakeStageInput(MakeSyntheticGroup(options));
    const Averaged averaged = Average(input);
    EXPECT_FALSE(averaged.failure);
    EXPECT_EQ(averaged.pairs.size(), input.pairs.size());
    EXPECT_EQ(averaged.directions.size(), input.pairs.size());
    ExpectNear(averaged.posed, input.truth, 1e-6, 1e-5);
    ExpectSameDatabasePoses(averaged.posed, input.layout.given);
  }
}

TEST_P(GroupsToAverage, OutlierPairsAreDropped) {
  SyntheticGroupOptions options = Group(GetParam().num_frames, GetParam().num_sensors);
  options.outlier_pair_ratio = 0.25;
  options.pixel_noise_px = 0.5;
  const StageInput input = MakeStageInput(MakeSyntheticGroup(options));
  const Averaged averaged = Average(input);
  ASSERT_FALSE(averaged.failure);
  const int num_outliers = 2 * input.layout.num_queries;  // the first two of the eight pairs of each query
  EXPECT_EQ(averaged.pairs.size(), input.pairs.size() - num_outliers);
  for (const PairGeometry* pair : averaged.pairs) {
    const std::vector<int>& image_of_pair = input.layout.image_of_pair[pair->query];
    EXPECT_TRUE(pair->other != image_of_pair[0] && pair->other != image_of_pair[1]);
  }
  ExpectNear(averaged.posed, input.truth, 0.1, 0.5);
  ExpectSameDatabasePoses(averaged.posed, input.layout.given);
}

TEST_P(GroupsToAverage, PairIsKeptWhoseMatchesFitAlthoughItsRotationDoesNot) {
  SyntheticGroupOptions options = Group(GetParam().num_frames, GetParam().num_sensors);
  options.pixel_noise_px = 0.5;
  StageInput input = MakeStageInput(MakeSyntheticGroup(options));
  PairGeometry& pair = input.pairs[1];
  pair.query_from_other.rotation = ExpSO3({0, DegToRad(12), 0}) * pair.query_from_other.rotation;
  const Averaged averaged = Average(input);
  ASSERT_FALSE(averaged.failure);
  ASSERT_EQ(averaged.pairs.size(), input.pairs.size());
  for (size_t i = 0; i < input.pairs.size(); ++i) EXPECT_EQ(averaged.pairs[i], &input.pairs[i]) << "in their order";
  EXPECT_TRUE(averaged.directions[1].dir_1to2_in_world.isZero()) << "unknown";
}

INSTANTIATE_TEST_SUITE_P(AverageMotion, GroupsToAverage,
                         testing::Values(GroupSize{1, 1}, GroupSize{1, 3}, GroupSize{3, 1}, GroupSize{2, 2}));

TEST(AverageMotion, DirectionsPointFromTheOtherImageToTheQuery) {
  const StageInput input = MakeStageInput(MakeSyntheticGroup(Group(2, 1)));
  const Averaged averaged = Average(input);
  for (size_t k = 0; k < averaged.pairs.size(); ++k) {
    const Eigen::Vector3d baseline = CamInWorld(CamFromWorld(input.truth, averaged.pairs[k]->query)) -
                                     CamInWorld(CamFromWorld(input.truth, averaged.pairs[k]->other));
    EXPECT_LE(AngleBetweenRad(averaged.directions[k].dir_1to2_in_world, baseline), 1e-6);
  }
}

TEST(AverageMotion, SharedDatabaseFramesGiveTheSamePoses) {
  SyntheticGroupOptions options = Group(2, 2);
  options.has_database_rigs = true;
  const StageInput input = MakeStageInput(MakeSyntheticGroup(options));
  ASSERT_EQ(input.layout.given.frames.size(), 2u + 2 * 4);
  ExpectNear(Average(input).posed, input.truth, 1e-6, 1e-5);
}

// Keeps the failure, because a single frame may be localized from another start.
TEST(AverageMotion, FailureOfASingleFrameIsKept) {
  SyntheticGroupOptions options = Group(1, 1);
  options.outlier_pair_ratio = 1;
  const StageInput input = MakeStageInput(MakeSyntheticGroup(options));
  const Averaged averaged = Average(input);
  ASSERT_TRUE(averaged.failure);
  EXPECT_EQ(averaged.failure->cause, QueryStatus::INCONSISTENT_ROTATIONS);
  EXPECT_THAT(averaged.failure->reason, HasSubstr("no two of 8 pairs agree"));
  EXPECT_EQ(averaged.pairs.size(), input.pairs.size());
  EXPECT_EQ(averaged.directions.size(), input.pairs.size());
}

TEST(AverageMotion, FailureOfOneOfSeveralFramesIsThrown) {
  SyntheticGroupOptions options = Group(3, 1);
  options.has_query_pairs = false;
  StageInput input = MakeStageInput(MakeSyntheticGroup(options));
  Random random(5);
  for (PairGeometry& pair : input.pairs) {
    if (pair.query == 1) pair.query_from_other.rotation = RandomRotation(&random);
  }
  const Failure failure = ThrownBy(input);
  EXPECT_EQ(failure.cause, QueryStatus::INCONSISTENT_ROTATIONS);
  EXPECT_THAT(failure.frames, ElementsAre(1));
}

TEST(AverageMotion, FramesThatAreLinkedToEachOtherOnlyAreNamed) {
  StageInput input = MakeStageInput(MakeSyntheticGroup(Group(3, 1)));
  std::vector<PairGeometry> pairs;
  for (const PairGeometry& pair : input.pairs) {
    const bool is_with_database = input.layout.IsDatabase(pair.other);
    if (is_with_database ? pair.query == 1 : pair.query == 2 && pair.other == 0) pairs.push_back(pair);
  }
  input.pairs = pairs;
  const Failure failure = ThrownBy(input);
  EXPECT_EQ(failure.cause, QueryStatus::TOO_FEW_INLIERS);
  EXPECT_THAT(failure.frames, ElementsAre(0, 2));
}

TEST(AverageMotion, DatabaseImagesOfOnePlaceLeaveRotationAndBearing) {
  SyntheticGroupOptions options = Group(1, 1);
  options.num_database_images = 1;
  options.pixel_noise_px = 0.5;
  SyntheticGroup scene = MakeSyntheticGroup(options);
  LocalizationProblem& problem = scene.group.images[0].problem;
  problem.pairs.push_back(problem.pairs.front());
  problem.pairs.back().other_name = "database200";
  const StageInput input = MakeStageInput(scene);
  const Failure failure = ThrownBy(input);
  EXPECT_EQ(failure.cause, QueryStatus::SCALE_UNOBSERVABLE);
  EXPECT_THAT(failure.frames, ElementsAre(0));
  ASSERT_EQ(failure.partial_poses.count(0), 1u);
  const PartialPose& partial = failure.partial_poses.at(0);
  const Rigid3d& truth = input.truth.frames[0].frame_from_world;
  EXPECT_LE(AngularDistanceRad(partial.cam_from_world_rotation, truth.rotation), 1e-6);  // as stored with the pairs
  ASSERT_TRUE(partial.bearing);
  const Eigen::Vector3d baseline = CamInWorld(truth) - CamInWorld(CamFromWorld(input.layout.given, 1));
  EXPECT_LE(AngleBetweenRad(partial.bearing->dir_database_to_query_in_world, baseline),
            4 * partial.bearing->stddev_rad);
  EXPECT_LE(partial.bearing->stddev_rad, 0.01);
}

TEST(AverageMotion, PanoramaLeavesTheRotation) {
  SyntheticSceneOptions options;
  options.layout = SceneLayout::PURE_ROTATION;
  const SyntheticScene scene = MakeSyntheticScene(options);
  const Averaged averaged = Average(MakeStageInput({LoneQuery(scene), {scene.query_cam_from_world}, {}}));
  ASSERT_TRUE(averaged.failure);
  EXPECT_EQ(averaged.failure->cause, QueryStatus::DEGENERATE_BASELINE);
  ASSERT_EQ(averaged.failure->partial_poses.count(0), 1u);
  const PartialPose& partial = averaged.failure->partial_poses.at(0);
  EXPECT_LE(AngularDistanceRad(partial.cam_from_world_rotation, scene.query_cam_from_world.rotation), 1e-6);
  EXPECT_FALSE(partial.bearing);
}

TEST(AverageMotion, WrongCalibrationIsThrownForASingleFrameToo) {
  SyntheticGroupOptions options = Group(1, 3);
  options.calibration_error_deg = 20;
  const Failure failure = ThrownBy(MakeStageInput(MakeSyntheticGroup(options)));
  EXPECT_EQ(failure.cause, QueryStatus::INCONSISTENT_RIG);
  EXPECT_THAT(failure.reason, HasSubstr("query0-2"));
}

}  // namespace
}  // namespace lazyloc

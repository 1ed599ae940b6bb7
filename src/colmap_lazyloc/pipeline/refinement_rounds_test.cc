#include "colmap_lazyloc/pipeline/refinement_rounds.h"

#include <cmath>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/bridge/observer.h"
#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr int kNumPoints = 60;

SyntheticGroupOptions Group(int num_frames, int num_sensors, double pixel_noise_px = 0) {
  SyntheticGroupOptions options;
  options.num_frames = num_frames;
  options.num_sensors = num_sensors;
  options.num_points = kNumPoints;
  options.pixel_noise_px = pixel_noise_px;
  return options;
}

// Returns the truth with query frames that are off by half a degree and 0.05, which is about 10 px.
PosedImages DisturbedStart(const StageInput& input) {
  Random random(2);
  PosedImages start = input.truth;
  for (Frame& frame : start.frames) {
    if (!frame.is_database) frame.frame_from_world = DisturbedPose(frame.frame_from_world, 0.5, 0.05, &random);
  }
  return start;
}

Refined RefineFrom(const PosedImages& start, const StageInput& input, const LocalizerOptions& options = {},
                   std::optional<QueryCamera> camera = {}) {
  StageTimer::Seconds seconds;
  return Refine(input.layout, start, {input.tracks, {}}, {input.tracks, input.tracks}, options, &seconds,
                std::move(camera));
}

// Displaces the observation of a track's query.
void DisplaceQuery(double offset_px, const SyntheticGroup& scene, Track* track) {
  TrackObservation& query = track->observations.front();
  const LocalizationProblem& problem = scene.group.images[query.image].problem;
  const Eigen::Vector2d xy = problem.query_keypoints[query.keypoint] + Eigen::Vector2d(offset_px, 0);
  query.observation = *Observer(problem.query_camera)(xy);
}

struct GroupSize {
  int num_frames, num_sensors;
};

class GroupsToRefine : public testing::TestWithParam<GroupSize> {};

TEST_P(GroupsToRefine, ConvergesToTheTruth) {
  const StageInput input = MakeStageInput(MakeSyntheticGroup(Group(GetParam().num_frames, GetParam().num_sensors)));
  const Refined refined = RefineFrom(DisturbedStart(input), input);
  ExpectNear(refined.adjustment.posed, input.truth, 1e-6, 1e-5);
  EXPECT_EQ(refined.adjustment.tracks.size(), input.tracks.size());
  ASSERT_EQ(refined.rig_errors_px.size(), static_cast<size_t>(input.layout.num_queries));
  for (const std::optional<double>& error_px : refined.rig_errors_px) {
    ASSERT_EQ(error_px.has_value(), GetParam().num_sensors > 1);
    EXPECT_LE(error_px.value_or(0), 0.01);
  }
}

TEST_P(GroupsToRefine, StaysNearTheTruthWithNoise) {
  const StageInput input = MakeStageInput(MakeSyntheticGroup(Group(GetParam().num_frames, GetParam().num_sensors, 1)));
  ExpectNear(RefineFrom(DisturbedStart(input), input).adjustment.posed, input.truth, 0.03, 0.2);
}

INSTANTIATE_TEST_SUITE_P(Refine, GroupsToRefine,
                         testing::Values(GroupSize{1, 1}, GroupSize{1, 3}, GroupSize{3, 1}, GroupSize{2, 2}));

TEST(Refine, DatabasePosesOfTheLayoutAreTheCentresOfThePriors) {
  const StageInput input = MakeStageInput(MakeSyntheticGroup(Group(1, 1, 1)));
  const PosedImages given = input.layout.given;
  const PosedImages posed = RefineFrom(DisturbedStart(input), input).adjustment.posed;
  ExpectSameDatabasePoses(input.layout.given, given);
  for (size_t i = 1; i < posed.frames.size(); ++i) {
    ASSERT_TRUE(posed.frames[i].prior);
    ExpectSameBits(posed.frames[i].prior->frame_from_world, given.frames[i].frame_from_world);
    EXPECT_NE(posed.frames[i].frame_from_world.translation, given.frames[i].frame_from_world.translation);
  }
}

TEST(Refine, ExactDatabasePosesKeepTheirBits) {
  const StageInput input = MakeStageInput(MakeSyntheticGroup(Group(1, 2, 1)));
  LocalizerOptions options;
  options.database_pose_stddev_deg = options.database_pose_stddev_length = 0;
  const PosedImages posed = RefineFrom(DisturbedStart(input), input, options).adjustment.posed;
  ExpectSameDatabasePoses(posed, input.layout.given);
  ExpectNear(posed, input.truth, 0.02, 0.2);
}

TEST(Refine, StatedPriorsAreUsed) {
  const StageInput input = MakeStageInput(MakeSyntheticGroup(Group(1, 1, 1)));
  LocalizerOptions options;
  options.database_pose_stddev_deg = 0.5;
  options.database_pose_stddev_length = 0.02;
  const PosedImages posed = RefineFrom(DisturbedStart(input), input, options).adjustment.posed;
  for (size_t i = 1; i < posed.frames.size(); ++i) {
    ASSERT_TRUE(posed.frames[i].prior);
    EXPECT_NEAR(posed.frames[i].prior->rotation_stddev_rad, 0.5 * M_PI / 180, 1e-12);
    EXPECT_EQ(posed.frames[i].prior->position_stddev, 0.02);
  }
}

TEST(Refine, CalibrationIsCorrectedForQueriesAndDatabaseTogether) {
  SyntheticGroupOptions options = Group(1, 2, 0.3);
  options.has_database_rigs = true;
  options.calibration_error_deg = 0.05;
  const SyntheticGroup scene = MakeSyntheticGroup(options);
  const StageInput input = MakeStageInput(scene);
  const PosedImages posed = RefineFrom(DisturbedStart(input), input).adjustment.posed;
  ASSERT_EQ(posed.calibrations.size(), 1u);
  const Rigid3d truth = scene.cam_from_world[1] * Inverse(scene.cam_from_world[0]);
  EXPECT_NEAR(RotationErrorDeg(input.layout.given.calibrations[0].cam_from_frame, truth), 0.05, 1e-4);
  EXPECT_LE(RotationErrorDeg(posed.calibrations[0].cam_from_frame, truth), 0.02);
  for (const Image& image : posed.images) {
    if (image.calibration < 0) continue;
    EXPECT_LE(RotationErrorDeg(image.cam_from_frame, posed.calibrations[0].cam_from_frame), 0.005) << "hardly flexes";
  }
}

TEST(Refine, TracksThatDisagreeAreRemoved) {
  const SyntheticGroup scene = MakeSyntheticGroup(Group(1, 1, 0.5));
  StageInput input = MakeStageInput(scene);
  for (int i = 0; i < 5; ++i) DisplaceQuery(i == 0 ? 20 : 200, scene, &input.tracks[10 * i]);
  const Refined refined = RefineFrom(DisturbedStart(input), input);
  for (const Track& track : refined.adjustment.tracks) {
    const int keypoint = track.observations.front().keypoint;
    EXPECT_FALSE(keypoint % 10 == 0 && keypoint < 50) << keypoint;
  }
  EXPECT_GE(refined.adjustment.tracks.size(), 0.9 * (kNumPoints - 5));
  ExpectNear(refined.adjustment.posed, input.truth, 0.02, 0.2);
}

// Displaces a keypoint by less than the bound of the first round (32 px), but more than the final one (16 px).
TEST(Refine, TracksThatDisagreeWithTheResultAreRemoved) {
  const SyntheticGroup scene = MakeSyntheticGroup(Group(1, 1));
  StageInput input = MakeStageInput(scene);
  DisplaceQuery(24, scene, &input.tracks[7]);
  const std::vector<Track> tracks = RefineFrom(input.truth, input).adjustment.tracks;
  EXPECT_EQ(tracks.size(), input.tracks.size() - 1);
  for (const Track& track : tracks) EXPECT_NE(track.observations.front().keypoint, 7);
}

TEST(Refine, FramesWithTooFewTracksAreNamed) {
  StageInput input = MakeStageInput(MakeSyntheticGroup(Group(3, 1)));
  input.tracks.erase(input.tracks.begin() + kNumPoints + 5, input.tracks.begin() + 2 * kNumPoints);
  const Failure failure = FailureOf([&] { RefineFrom(input.truth, input); });
  EXPECT_EQ(failure.cause, QueryStatus::TOO_FEW_TRACKS);
  EXPECT_THAT(failure.frames, ElementsAre(1));
  EXPECT_THAT(failure.reason, HasSubstr("5 of 125 tracks"));
}

TEST(Refine, TracksThatNoStartFitsAreTooFew) {
  const StageInput input = MakeStageInput(MakeSyntheticGroup(Group(1, 1)));
  Random random(1);
  PosedImages start = input.truth;
  start.frames[0].frame_from_world = DisturbedPose(start.frames[0].frame_from_world, 20, 0, &random);
  const Failure failure = FailureOf([&] { RefineFrom(start, input); });
  EXPECT_EQ(failure.cause, QueryStatus::TOO_FEW_TRACKS);
}

TEST(Refine, WrongCalibrationIsNamed) {
  SyntheticGroupOptions options = Group(1, 3, 0.5);
  options.calibration_error_deg = 10;
  const StageInput input = MakeStageInput(MakeSyntheticGroup(options));
  const Failure failure = FailureOf([&] { RefineFrom(input.truth, input); });
  EXPECT_EQ(failure.cause, QueryStatus::INCONSISTENT_RIG);
  EXPECT_THAT(failure.reason, HasSubstr("query0-2"));
}

TEST(Refine, ScaleOfAFrameIsFound) {
  SyntheticGroup scene = MakeSyntheticGroup(Group(1, 4));
  for (QueryImage& image : scene.group.images) image.cam_from_rig.translation /= 1.05;
  scene.group.has_rig_scale = false;
  const StageInput input = MakeStageInput(scene);
  const PosedImages posed = RefineFrom(DisturbedStart(input), input).adjustment.posed;
  EXPECT_NEAR(posed.frames[0].scale, 1.05, 1e-5);
  for (int query = 0; query < 4; ++query) {
    const Rigid3d pose = CamFromWorld(posed, query);
    EXPECT_LE((CamInWorld(pose) + input.layout.origin - CamInWorld(scene.cam_from_world[query])).norm(), 1e-5);
  }
}

TEST(Refine, FocalLengthOfTheCameraIsFound) {
  SyntheticGroup scene = MakeSyntheticGroup(Group(1, 1));
  StageInput input = MakeStageInput(scene);
  LocalizationProblem problem = scene.group.images[0].problem;
  problem.query_camera = WithFocalFactor(problem.query_camera, 1.02);
  const QueryCamera camera(problem);
  input.tracks = camera.Observe(input.tracks);
  PosedImages start = DisturbedStart(input);
  start.images[0].log_focal_factor = 0;
  const Refined refined = RefineFrom(start, input, {}, camera);
  ASSERT_TRUE(refined.camera);
  EXPECT_NEAR(refined.camera->Intrinsics().params[0], 800, 1e-3);
  ExpectNear(refined.adjustment.posed, input.truth, 1e-5, 1e-4);
}

}  // namespace
}  // namespace lazyloc

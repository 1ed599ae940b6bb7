#include "colmap_lazyloc/initialization/start_selection.h"

#include <algorithm>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/testing/stage_input.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

const TrackRefs kNoTracks;

// Holds the tracks of a scene as the start problem of its first frame: all have points, or none has.
class Problem {
 public:
  Problem(const SyntheticTracks& scene, double max_error_px, bool has_points = true)
      : tracks_(Refs(scene.tracks)),
        problem_{scene.posed, has_points ? tracks_ : kNoTracks, has_points ? kNoTracks : tracks_, max_error_px} {}
  Problem(const Problem&) = delete;
  operator const StartProblem&() const { return problem_; }  // NOLINT(google-explicit-constructor)

 private:
  const TrackRefs tracks_;
  const StartProblem problem_;
};

const Rigid3d& TrueQueryPose(const SyntheticTracks& scene) { return scene.posed.frames[0].frame_from_world; }

// Leaves each track one database image, in turn.
SyntheticTracks SingleImageTracks(double noise_px) {
  SyntheticTracksOptions options;
  options.noise_px = noise_px;
  options.num_points = 200;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  for (size_t i = 0; i < scene.tracks.size(); ++i) {
    std::vector<TrackObservation>& observations = scene.tracks[i].observations;
    observations = {observations[0], observations[1 + i % (observations.size() - 1)]};
  }
  return scene;
}

TEST(StartSelection, AbsolutePoseIsNearTheTruth) {
  SyntheticTracksOptions options;
  options.noise_px = 0.5;
  const SyntheticTracks scene = MakeSyntheticTracks(options);
  const std::optional<Rigid3d> pose = AbsolutePoseStart(Problem(scene, 16), /*seed=*/1);
  ASSERT_TRUE(pose.has_value());
  EXPECT_LE(PositionError(*pose, TrueQueryPose(scene)), 0.1);
}

TEST(StartSelection, GeneralizedRelativePoseNeedsNoPointOfTwoDatabaseImages) {
  const SyntheticTracks scene = SingleImageTracks(0.2);
  const Problem problem(scene, 16, /*has_points=*/false);
  EXPECT_FALSE(AbsolutePoseStart(problem, 1).has_value());
  const std::optional<Rigid3d> pose = GeneralizedRelativePoseStart(problem, 1);
  ASSERT_TRUE(pose.has_value());
  EXPECT_LE(PositionError(*pose, TrueQueryPose(scene)), 0.5);
  EXPECT_LE(RotationErrorDeg(*pose, TrueQueryPose(scene)), 5);
}

TEST(StartSelection, ScorePrefersTheTruth) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  const Rigid3d truth = TrueQueryPose(scene);
  Rigid3d wrong = truth;
  wrong.translation += Eigen::Vector3d(0.1, 0, 0);
  EXPECT_NEAR(ScoreStart(Problem(scene, 16), truth), static_cast<double>(scene.tracks.size()), 1e-6);
  EXPECT_LT(ScoreStart(Problem(scene, 16), wrong), ScoreStart(Problem(scene, 16), truth));
  const SyntheticTracks single = SingleImageTracks(0);
  const Problem problem(single, 16, /*has_points=*/false);
  EXPECT_NEAR(ScoreStart(problem, truth), 0.5 * static_cast<double>(single.tracks.size()), 1e-6);
  EXPECT_LT(ScoreStart(problem, wrong), ScoreStart(problem, truth));
}

TEST(StartSelection, ScoreIsTruncated) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  const Rigid3d truth = TrueQueryPose(scene);
  // Keeps six right points: the truth still scores on them.
  Random random(1);
  for (size_t i = 6; i < scene.tracks.size(); ++i) scene.tracks[i].point_in_world = 2 * RandomVector(&random);
  EXPECT_GE(ScoreStart(Problem(scene, 4), truth), 6 - 1e-6);
}

TEST(StartSelection, FewTracksGiveNoHypothesis) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  scene.tracks.resize(2);
  EXPECT_FALSE(AbsolutePoseStart(Problem(scene, 16), 1).has_value());
  EXPECT_FALSE(GeneralizedRelativePoseStart(Problem(scene, 16), 1).has_value());
}

TEST(StartSelection, SameSeedSameResult) {
  SyntheticTracksOptions options;
  options.noise_px = 2;
  const SyntheticTracks scene = MakeSyntheticTracks(options);
  for (const auto estimate : {AbsolutePoseStart, GeneralizedRelativePoseStart}) {
    const std::optional<Rigid3d> first = estimate(Problem(scene, 16), 5), second = estimate(Problem(scene, 16), 5);
    ASSERT_TRUE(first && second);
    EXPECT_EQ(first->rotation.coeffs(), second->rotation.coeffs());
    EXPECT_EQ(first->translation, second->translation);
  }
}

// Input of ChooseStart: averaged poses, and the tracks that judge them.
struct ChoiceInput {
  StageInput stages;
  Averaged averaged;
  SplitTracks tracks;

  Start Choose() const { return ChooseStart(stages.layout, averaged, tracks, {}); }
};

ChoiceInput MakeChoice(int num_frames, int num_sensors = 1) {
  SyntheticGroupOptions options;
  options.num_frames = num_frames;
  options.num_sensors = num_sensors;
  options.num_points = 60;
  ChoiceInput input;
  input.stages = MakeStageInput(MakeSyntheticGroup(options));
  input.averaged.posed = input.stages.truth;
  input.tracks.from_database = input.stages.tracks;
  return input;
}

// Moves the averaged pose of a frame.
void Disturb(int frame, ChoiceInput* input) {
  Random random(1);
  Rigid3d& pose = input->averaged.posed.frames[frame].frame_from_world;
  pose = DisturbedPose(pose, 5, 1, &random);
}

TEST(ChooseStart, AbsolutePoseReplacesAWrongAverage) {
  for (const int num_sensors : {1, 2}) {
    ChoiceInput input = MakeChoice(1, num_sensors);
    Disturb(0, &input);
    const Start start = input.Choose();
    EXPECT_EQ(start.kinds, std::vector<StartPose>{StartPose::ABSOLUTE_POSE});
    ExpectNear(start.posed, input.stages.truth, 1e-3, 0.01);
    ExpectSameDatabasePoses(start.posed, input.stages.layout.given);
  }
}

// Displaces points together, so that they give a wrong absolute pose. Most tracks have one database image and fit the
// averaged pose.
TEST(ChooseStart, AverageIsKeptIfMoreTracksFitIt) {
  ChoiceInput input = MakeChoice(1);
  const size_t num_displaced = 35;
  input.tracks.rest.assign(input.stages.tracks.begin(), input.stages.tracks.end());
  for (int i = 0; i < 2; ++i) {  // three tracks for each point, with different database images
    input.tracks.rest.insert(input.tracks.rest.end(), input.stages.tracks.begin(), input.stages.tracks.end());
  }
  for (size_t i = 0; i < input.tracks.rest.size(); ++i) {
    std::vector<TrackObservation>& observations = input.tracks.rest[i].observations;
    observations = {observations[0], observations[1 + i / input.stages.tracks.size()]};
  }
  input.tracks.from_database.resize(num_displaced);
  for (Track& track : input.tracks.from_database) track.point_in_world += Eigen::Vector3d(1, 0.5, 0);
  const Start start = input.Choose();
  EXPECT_EQ(start.kinds, std::vector<StartPose>{StartPose::MOTION_AVERAGING});
  ExpectSameBits(start.posed.frames[0].frame_from_world, input.stages.truth.frames[0].frame_from_world);
}

TEST(ChooseStart, EachFrameHasItsOwnChoice) {
  ChoiceInput input = MakeChoice(2);
  Disturb(0, &input);
  const auto is_of_frame_1 = [](const Track& track) { return track.observations.front().image == 1; };
  std::vector<Track>& tracks = input.tracks.from_database;
  const auto first = std::find_if(tracks.begin(), tracks.end(), is_of_frame_1);
  tracks.erase(first + 3, tracks.end());  // three tracks are too few for an absolute pose
  const Start start = input.Choose();
  EXPECT_EQ(start.kinds, (std::vector<StartPose>{StartPose::ABSOLUTE_POSE, StartPose::MOTION_AVERAGING}));
  ExpectNear(start.posed, input.stages.truth, 1e-3, 0.01);
}

// Among poses that all fit the matches within RANSAC's wide bound, it takes any.
TEST(ChooseStart, GeneralizedRelativePoseIsPrecise) {
  ChoiceInput input = MakeChoice(1);
  input.averaged.failure = Failure{QueryStatus::INCONSISTENT_ROTATIONS, "pairs contradict each other"};
  std::vector<Track>& matches = input.tracks.rest;
  matches = std::exchange(input.tracks.from_database, {});
  for (size_t i = 0; i < matches.size(); ++i) {
    std::vector<TrackObservation>& observations = matches[i].observations;
    observations = {observations[0], observations[1 + i % (observations.size() - 1)]};
  }
  std::vector<double> errors;
  for (uint32_t seed = 0; seed < 11; ++seed) {
    LocalizerOptions options;
    options.seed = seed;
    const Start start = ChooseStart(input.stages.layout, input.averaged, input.tracks, options);
    ASSERT_EQ(start.kinds, std::vector<StartPose>{StartPose::GENERALIZED_RELATIVE_POSE});
    const auto pose_of = [](const PosedImages& posed) { return posed.frames[0].frame_from_world; };
    errors.push_back(PositionError(pose_of(start.posed), pose_of(input.stages.truth)));
  }
  EXPECT_LE(Median(errors), 0.2);
}

TEST(ChooseStart, AnotherStartReplacesAFailedAverage) {
  ChoiceInput input = MakeChoice(1);
  input.averaged.posed = input.stages.layout.given;
  input.averaged.failure = Failure{QueryStatus::INCONSISTENT_ROTATIONS, "pairs contradict each other"};
  const Start start = input.Choose();
  EXPECT_EQ(start.kinds, std::vector<StartPose>{StartPose::ABSOLUTE_POSE});
  ExpectNear(start.posed, input.stages.truth, 1e-3, 0.01);
}

// Uses eight tracks, whose score is at most 8; a pose that motion averaging has not confirmed needs 12.
TEST(ChooseStart, FailureOfAveragingIsThrownWithoutAnotherStart) {
  ChoiceInput input = MakeChoice(1);
  input.averaged.failure = Failure{QueryStatus::INCONSISTENT_ROTATIONS, "pairs contradict each other"};
  for (const size_t num_tracks : {8, 0}) {
    input.tracks.from_database.resize(num_tracks);
    for (Track& track : input.tracks.from_database) track.observations.resize(3);  // too few rays for a relative pose
    const Failure failure = FailureOf([&] { input.Choose(); });
    EXPECT_EQ(failure.cause, QueryStatus::INCONSISTENT_ROTATIONS);
    EXPECT_EQ(failure.reason, "pairs contradict each other");
  }
}

}  // namespace
}  // namespace lazyloc

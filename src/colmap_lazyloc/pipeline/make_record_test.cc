#include "colmap_lazyloc/pipeline/make_record.h"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/stage_input.h"
#include "colmap_lazyloc/uncertainty/confidence.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;

constexpr int kNumPoints = 30, kNumDatabaseImages = 4;

// A group with the solution that has the true poses, and nothing else.
struct SolvedGroup {
  SolvedGroup(int num_frames, int num_sensors)
      : scene(MakeGroup(num_frames, num_sensors, kNumPoints, kNumDatabaseImages)),
        input(MakeStageInput(scene)),
        num_queries(scene.group.images.size()),
        prepared{scene.group,
                 input.layout,
                 {{}, std::vector<std::vector<int>>(num_queries, std::vector<int>(kNumDatabaseImages, 0))}} {
    solution.prepared = &prepared;
    solution.priors.resize(num_queries);
    solution.checked.posed = input.truth;
    solution.checked.results.resize(num_queries);
    solution.checked.poses.resize(num_queries);
  }

  std::vector<LocalizationResult> Results(const LocalizerOptions& options = {}) const {
    return MakeResults(Choice(solution), options);
  }

  SyntheticGroup scene;
  StageInput input;
  const size_t num_queries;
  Prepared prepared;
  Solution solution;
};

TEST(MakeResults, PosesAreLocalized) {
  const SolvedGroup group(1, 2);
  const std::vector<LocalizationResult> results = group.Results();
  ASSERT_EQ(results.size(), 2u);
  EXPECT_EQ(results[1].status, QueryStatus::LOCALIZED);
  EXPECT_EQ(results[1].query_name, "query0-1");
  EXPECT_EQ(results[1].frame_name, "frame0");
  EXPECT_EQ(results[1].query_camera.params, group.scene.group.images[1].problem.query_camera.params);
  EXPECT_FALSE(results[1].is_camera_refined);
  EXPECT_FALSE(results[1].confidence) << "nothing is known of it";
  ASSERT_EQ(results[1].pairs.size(), static_cast<size_t>(kNumDatabaseImages));
  EXPECT_EQ(results[1].pairs[2].database_name, "database102");
  EXPECT_EQ(results[1].pairs[2].num_inliers, 0);
  EXPECT_TRUE(std::isnan(results[1].pairs[2].rotation_error_deg));
}

TEST(MakeResults, FailureKeepsWhatWasKnown) {
  SolvedGroup group(1, 2);
  group.prepared.estimates.num_inliers = {{40, 0, 20, 30}, {1, 2, 3, 4}};
  group.solution.starts = {StartPose::ABSOLUTE_POSE};
  Failure failure{QueryStatus::INCONSISTENT_RIG, "does not fit"};
  failure.rig_errors_px = {0.5, std::nullopt};
  failure.partial_poses[1].rotation_stddev_rad = 0.25;
  group.solution.failure = failure;
  const std::vector<LocalizationResult> results = group.Results();
  for (int query = 0; query < 2; ++query) {
    EXPECT_EQ(results[query].status, QueryStatus::INCONSISTENT_RIG);
    EXPECT_EQ(results[query].reason, "does not fit");
    EXPECT_EQ(results[query].start, "absolute_pose");
  }
  EXPECT_EQ(results[0].pairs[2].num_inliers, 20);
  EXPECT_EQ(results[1].pairs[2].num_inliers, 3);
  EXPECT_EQ(results[0].rig_error_px, 0.5);
  EXPECT_EQ(results[1].rig_error_px, std::nullopt);
  EXPECT_FALSE(results[0].partial_pose);
  ASSERT_TRUE(results[1].partial_pose);
  EXPECT_EQ(results[1].partial_pose->rotation_stddev_rad, 0.25);
}

TEST(MakeResults, QueriesBelowTheMinimumConfidenceAreNotLocalized) {
  SolvedGroup group(2, 2);
  PoseEvidence good, bad;
  good.num_common_tracks = 200;
  good.explained_ratio = 1;
  bad.num_common_tracks = 0;
  bad.median_error_px = bad.position_stddev_ratio = 1;
  group.solution.evidence = {good, bad};
  group.solution.competing_poses.resize(2);
  LocalizerOptions options;
  options.min_confidence = 0.5;
  std::vector<LocalizationResult> results = group.Results(options);
  for (const int query : {0, 1}) {
    EXPECT_EQ(results[query].status, QueryStatus::LOCALIZED);
    EXPECT_GT(*results[query].confidence, 0.9);
    EXPECT_EQ(results[query].reason, "");
  }
  for (const int query : {2, 3}) {
    EXPECT_EQ(results[query].status, QueryStatus::LOW_CONFIDENCE);
    EXPECT_LT(*results[query].confidence, 0.5);
    EXPECT_NE(results[query].reason, "");
  }
  options.min_confidence = *results[0].confidence;
  EXPECT_EQ(group.Results(options)[0].status, QueryStatus::LOCALIZED);
}

TEST(MakeResults, ContradictedIntrinsicsAreRefusedUnlessTheyAreKept) {
  SolvedGroup group(2, 2);
  group.solution.checked.results[1] = {IntrinsicsOrigin::GIVEN, IntrinsicsVerdict::CONTRADICTED, 1, 0, "too long"};
  LocalizerOptions options;
  std::vector<LocalizationResult> results = group.Results(options);
  for (const int query : {0, 1}) {
    EXPECT_EQ(results[query].status, QueryStatus::INCONSISTENT_INTRINSICS) << "the images of a frame share a pose";
    EXPECT_EQ(results[query].reason, "too long");
  }
  EXPECT_EQ(results[2].status, QueryStatus::LOCALIZED);
  options.intrinsics = IntrinsicsMode::GIVEN;
  results = group.Results(options);
  EXPECT_EQ(results[1].status, QueryStatus::LOCALIZED);
  EXPECT_EQ(results[1].intrinsics.contradiction, "too long");
}

TEST(MakeResults, CovarianceAllowsForWhatAnEstimateOfTheFocalLengthAdds) {
  SolvedGroup group(1, 1);
  PoseDistribution& pose = group.solution.checked.poses[0];
  pose.of_images.setIdentity();
  pose.by_log_focal[0] = 3;
  Choice choice(group.solution);
  choice.extra_log_focal_variance = 0.25;
  const LocalizationResult result = MakeResults(choice, {}).front();
  EXPECT_NEAR(result.covariance(0, 0), 1 + 0.25 * 9, 1e-12);
  EXPECT_NEAR(result.covariance(1, 1), 1, 1e-12);
}

TEST(MakeResults, RunnerUpIsTheMoreProbableOfCompetingPoseAndOtherSolution) {
  SolvedGroup group(1, 1);
  PoseEvidence& evidence = group.solution.evidence.emplace_back();
  evidence.num_common_tracks = 200;
  evidence.explained_ratio = 0.8;
  group.solution.competing_poses = {std::nullopt};
  EXPECT_FALSE(group.Results().front().runner_up);

  Solution other = group.solution;
  other.hypothesis.estimates_focal_length = true;
  other.evidence[0].num_common_tracks = 5;
  Choice choice(group.solution);
  choice.runner_up = &other;
  LocalizationResult result = MakeResults(choice, {}).front();
  ASSERT_TRUE(result.runner_up);
  const double confidence = Confidence(other.evidence[0]);
  EXPECT_NEAR(result.runner_up->odds, confidence / (1 - confidence) * (1 / *result.confidence - 1), 1e-12);
  EXPECT_THAT(result.runner_up->explanation, HasSubstr("as the images suggest"));
  EXPECT_LE(PositionError(result.runner_up->cam_from_world, group.scene.cam_from_world[0]), 1e-9);

  Random random(1);
  const Rigid3d& pose = group.input.truth.frames[0].frame_from_world;
  group.solution.competing_poses = {DisturbedPose(pose, 20, 1, &random)};
  evidence.competing_ratio = 0.1;
  result = MakeResults(choice, {}).front();
  EXPECT_LT(result.runner_up->odds, 1);
  EXPECT_THAT(result.runner_up->explanation, HasSubstr("as the images suggest"))
      << "few points speak for the competing pose";
  evidence.competing_ratio = 1.5;
  other.evidence[0].num_common_tracks = 1;
  result = MakeResults(choice, {}).front();
  EXPECT_EQ(result.runner_up->odds, OddsOfCompetingPose(evidence));
  EXPECT_THAT(result.runner_up->explanation, HasSubstr("with 150 % of its score"));
  EXPECT_NEAR(PositionError(result.runner_up->cam_from_world, group.scene.cam_from_world[0]), 1, 1e-9);
}

TEST(MakeResults, StartIsThatOfTheFrame) {
  SolvedGroup group(2, 2);
  group.solution.starts = {StartPose::MOTION_AVERAGING, StartPose::ABSOLUTE_POSE};
  std::vector<std::string> starts;
  for (const LocalizationResult& result : group.Results()) starts.push_back(result.start);
  EXPECT_THAT(starts, ElementsAre("motion_averaging", "motion_averaging", "absolute_pose", "absolute_pose"));
}

TEST(MakeResults, PosesAreThoseOfTheDatabasesCoordinates) {
  const SolvedGroup group(2, 3);
  ASSERT_GT(group.input.layout.origin.norm(), 0.1);
  const std::vector<LocalizationResult> results = group.Results();
  const std::vector<Rigid3d>& truth = group.scene.cam_from_world;
  for (size_t query = 0; query < results.size(); ++query) {
    EXPECT_LE(PositionError(results[query].cam_from_world, truth[query]), 1e-9);
    EXPECT_LE(RotationErrorDeg(results[query].cam_from_world, truth[query]), 1e-5);
    EXPECT_LE(PositionError(results[query].rig_from_world, truth[query / 3 * 3]), 1e-9);
    EXPECT_EQ(results[query].rig_scale, 1);
  }
}

TEST(MakeResults, EstimatedScaleIsPartOfTheRig) {
  SolvedGroup group(1, 3);
  PosedImages& posed = group.solution.checked.posed;
  posed.frames[0].scale = 2;
  for (Image& image : posed.images) image.cam_from_frame.translation *= 2;
  for (const LocalizationResult& result : group.Results()) {
    EXPECT_EQ(result.rig_scale, 2);
    EXPECT_LE(PositionError(result.rig_from_world, group.scene.cam_from_world[0]), 1e-9);
  }
}

TEST(MakeResults, PairErrorsAreThoseOfThePairsInUse) {
  SolvedGroup group(2, 1);
  Random random(1);
  PosedImages& posed = group.solution.checked.posed;
  Rigid3d& pose = posed.frames[1].frame_from_world;
  const Eigen::Vector3d centre = CamInWorld(pose);
  pose = CamFromWorld(Disturbed(pose.rotation, 1, &random), centre);
  const std::vector<PairGeometry>& pairs = group.input.pairs;
  Averaged& averaged = group.solution.averaged;
  for (const int pair : {0, 4, 5, 8}) averaged.pairs.push_back(&pairs[pair]);  // the last one is of two queries
  averaged.directions.resize(4);
  averaged.directions[1].dir_1to2_in_world =
      DisturbedDirection(centre - CamInWorld(CamFromWorld(posed, pairs[4].other)), 2, &random).normalized();
  const std::vector<LocalizationResult> results = group.Results();
  EXPECT_NEAR(results[0].pairs[0].rotation_error_deg, 0, 1e-5);
  EXPECT_TRUE(std::isnan(results[0].pairs[1].rotation_error_deg));
  EXPECT_NEAR(results[1].pairs[0].rotation_error_deg, 1, 1e-5);
  EXPECT_NEAR(results[1].pairs[1].rotation_error_deg, 1, 1e-5);
  EXPECT_NEAR(results[1].pairs[0].direction_error_deg, 2, 1e-5);
  EXPECT_TRUE(std::isnan(results[1].pairs[1].direction_error_deg)) << "the pair has no direction";
}

// Checks that corrections of database poses do not count, because a reader of the result has the poses as given.
TEST(MakeResults, PointsHaveErrorsAgainstTheDatabaseAsGiven) {
  SolvedGroup group(1, 1);
  Refined& refined = group.solution.refined.emplace();
  refined.adjustment.posed = group.input.truth;
  refined.adjustment.tracks = group.input.tracks;
  refined.rig_errors_px = {0.125};
  Random random(1);
  for (Frame& frame : refined.adjustment.posed.frames) {
    if (frame.is_database) frame.frame_from_world = DisturbedPose(frame.frame_from_world, 1, 0.1, &random);
  }
  const LocalizationResult result = group.Results().front();
  EXPECT_EQ(result.rig_error_px, 0.125);
  EXPECT_EQ(result.num_tracks, kNumPoints);
  EXPECT_EQ(result.num_observations, kNumPoints * (1 + kNumDatabaseImages));
  EXPECT_LE(result.mean_reprojection_error_px, 1e-6);
  ASSERT_EQ(result.points.size(), static_cast<size_t>(kNumPoints));
  for (int i = 0; i < kNumPoints; ++i) {
    EXPECT_LE((result.points[i].point_in_world - group.scene.points_in_world[i]).norm(), 1e-12);
    EXPECT_EQ(result.points[i].query_point, i);
    EXPECT_THAT(result.points[i].observations, ElementsAre(Pair(0, i), Pair(1, i), Pair(2, i), Pair(3, i)));
    EXPECT_LE(result.points[i].mean_reprojection_error_px, 1e-6);
  }
}

TEST(MakeResults, ATrackOfTwoQueriesCountsForBoth) {
  SolvedGroup group(1, 2);
  Refined& refined = group.solution.refined.emplace();
  refined.adjustment.posed = group.input.truth;
  Track track = group.input.tracks[3];
  track.observations.resize(2);  // query 0 and one database image
  track.observations.insert(track.observations.begin() + 1, group.input.tracks[kNumPoints + 3].observations.front());
  refined.adjustment.tracks = {track};
  refined.rig_errors_px.resize(2);
  for (const LocalizationResult& result : group.Results()) {
    EXPECT_EQ(result.num_tracks, 1);
    EXPECT_EQ(result.num_observations, 2);
    ASSERT_EQ(result.points.size(), 1u);
    EXPECT_THAT(result.points[0].observations, ElementsAre(Pair(0, 3)));
  }
}

TEST(MakeResults, UncertaintiesAndCameraAreThoseOfTheQuery) {
  SolvedGroup group(1, 2);
  for (int query = 0; query < 2; ++query) {
    PoseDistribution& pose = group.solution.checked.poses[query];
    pose.of_images = (query + 1) * PoseDistribution::Matrix::Identity();
  }
  Camera camera = group.scene.group.images[0].problem.query_camera;
  camera.params[0] = 500;
  group.solution.checked.cameras = {camera, std::nullopt};
  const std::vector<LocalizationResult> results = group.Results();
  for (int query = 0; query < 2; ++query) {
    EXPECT_EQ(results[query].covariance(1, 1), query + 1);
    EXPECT_NEAR(results[query].spread.rotation_stddev_rad, std::sqrt(query + 1), 1e-12);
    EXPECT_EQ(results[query].is_camera_refined, query == 0);
  }
  EXPECT_EQ(results[0].query_camera.params[0], 500);
}

// Returns the choice of a solution for one of its images.
ImageChoice ChoiceOf(const Solution& solution, int query, const StageTimer::Seconds& seconds = {}) {
  return {std::make_shared<Choice>(solution), query, seconds};
}

TEST(MakeResults, EachImageHasTheSolutionThatIsChosenForIt) {
  const SolvedGroup together(2, 1);
  SolvedGroup failed(1, 1);
  failed.solution.failure = Failure{QueryStatus::TOO_FEW_TRACKS, "alone"};
  const std::vector<LocalizationResult> results =
      MakeResults({ChoiceOf(together.solution, 1, {{"tracks", 1}}), ChoiceOf(failed.solution, 0, {{"tracks", 2}})}, {});
  ASSERT_EQ(results.size(), 2u);
  EXPECT_EQ(results[0].query_name, "query1-0");
  EXPECT_EQ(results[0].status, QueryStatus::LOCALIZED);
  EXPECT_THAT(results[0].seconds, ElementsAre(Pair("tracks", 1)));
  EXPECT_EQ(results[1].status, QueryStatus::TOO_FEW_TRACKS);
  EXPECT_EQ(results[1].reason, "alone");
  EXPECT_THAT(results[1].seconds, ElementsAre(Pair("tracks", 2)));
}

TEST(MakeResults, ScaleThatWasAppliedBeforeIsPartOfTheRigScale) {
  SolvedGroup group(1, 3);
  for (QueryImage& image : group.scene.group.images) image.rig_scale = 3;
  group.solution.checked.posed.frames[0].scale = 2;
  for (const LocalizationResult& result : group.Results()) EXPECT_EQ(result.rig_scale, 6);
}

LocalizationResult MakeResult(const std::string& name, QueryStatus status, const StageTimer::Seconds& seconds = {}) {
  LocalizationResult result;
  result.query_name = name;
  result.status = status;
  result.seconds = seconds;
  return result;
}

TEST(AddResult, JoinsLoadingAndPipelineAndSumsStagesThatRanTwice) {
  QueryRecord record;
  record.keypoints = {{1, 2}};
  record.seconds = {{"load", 1}};
  AddResult(MakeResult("a", QueryStatus::LOCALIZED, {{"two_view", 0.25}, {"load", 2}, {"two_view", 1}}), &record);
  EXPECT_EQ(record.result.query_name, "a");
  EXPECT_EQ(record.keypoints.size(), 1u);
  EXPECT_THAT(record.seconds, ElementsAre(Pair("load", 3), Pair("two_view", 1.25)));
}

TEST(AddResult, SaysWhatWasLeftOut) {
  QueryRecord record;
  record.damages = {"table a, image 1: bad"};
  AddResult(MakeResult("a", QueryStatus::NO_PAIRS), &record);
  EXPECT_EQ(record.result.status, QueryStatus::DAMAGED_DATA);
  EXPECT_EQ(record.result.reason, "left out: table a, image 1: bad");
  record.damages.emplace_back("table a, image 2: bad");
  LocalizationResult result = MakeResult("a", QueryStatus::TOO_FEW_TRACKS);
  result.reason = "only 2 tracks";
  AddResult(result, &record);
  EXPECT_EQ(record.result.status, QueryStatus::TOO_FEW_TRACKS);
  EXPECT_EQ(record.result.reason, "only 2 tracks; left out: table a, image 1: bad (2 damaged records)");
  AddResult(MakeResult("a", QueryStatus::LOCALIZED), &record);
  EXPECT_EQ(record.result.reason, "");
}

TEST(AddRefusal, IsTheStatusOfTheQuery) {
  QueryRecord record;
  record.result.query_name = "a";
  AddRefusal({QueryStatus::UNREADABLE_IMAGE, "no image"}, &record);
  EXPECT_EQ(record.result.query_name, "a");
  EXPECT_EQ(record.result.status, QueryStatus::UNREADABLE_IMAGE);
  EXPECT_EQ(record.result.reason, "no image");
}

}  // namespace
}  // namespace lazyloc

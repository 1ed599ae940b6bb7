#include "colmap_lazyloc/pipeline/report.h"

#include <cmath>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/pipeline/stages_test_input.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::Pair;

constexpr int kNumPoints = 30, kNumDatabaseImages = 4;

SyntheticGroup MakeGroup(int num_frames, int num_sensors) {
  SyntheticGroupOptions options;
  options.num_frames = num_frames;
  options.num_sensors = num_sensors;
  options.num_points = kNumPoints;
  options.num_database_images = kNumDatabaseImages;
  return MakeSyntheticGroup(options);
}

TEST(Report, NewResultsAreLocalized) {
  const SyntheticGroup scene = MakeGroup(1, 2);
  const std::vector<LocalizationResult> results = Report(scene.group).Finish();
  ASSERT_EQ(results.size(), 2u);
  EXPECT_EQ(results[1].status, QueryStatus::LOCALIZED);
  EXPECT_EQ(results[1].query_name, "query0-1");
  EXPECT_EQ(results[1].frame_name, "frame0");
  EXPECT_EQ(results[1].query_camera.params, scene.group.images[1].problem.query_camera.params);
  EXPECT_FALSE(results[1].is_camera_refined);
  ASSERT_EQ(results[1].pairs.size(), static_cast<size_t>(kNumDatabaseImages));
  EXPECT_EQ(results[1].pairs[2].database_name, "database102");
  EXPECT_EQ(results[1].pairs[2].num_inliers, 0);
  EXPECT_TRUE(std::isnan(results[1].pairs[2].rotation_error_deg));
}

TEST(Report, FailureKeepsWhatWasKnown) {
  const SyntheticGroup scene = MakeGroup(1, 2);
  const StageInput input = MakeStageInput(scene);
  Report report(scene.group);
  report.AddPairs({{}, {{40, 0, 20, 30}, {1, 2, 3, 4}}});
  report.AddStart(input.layout, {input.truth, {StartPose::ABSOLUTE_POSE}});
  report.AddPoses(input.layout, input.truth);
  Failure failure{QueryStatus::INCONSISTENT_RIG, "does not fit"};
  failure.rig_errors_px = {0.5, std::nullopt};
  failure.partial_poses[1].rotation_stddev_rad = 0.25;
  report.AddFailure(failure);
  const std::vector<LocalizationResult> results = std::move(report).Finish();
  for (int query = 0; query < 2; ++query) {
    EXPECT_EQ(results[query].status, QueryStatus::INCONSISTENT_RIG);
    EXPECT_EQ(results[query].reason, "does not fit");
    EXPECT_EQ(results[query].start, "absolute_pose");
    EXPECT_LE(PositionError(results[query].cam_from_world, scene.cam_from_world[query]), 1e-9);
  }
  EXPECT_EQ(results[0].pairs[2].num_inliers, 20);
  EXPECT_EQ(results[1].pairs[2].num_inliers, 3);
  EXPECT_EQ(results[0].rig_error_px, 0.5);
  EXPECT_EQ(results[1].rig_error_px, std::nullopt);
  EXPECT_FALSE(results[0].partial_pose);
  ASSERT_TRUE(results[1].partial_pose);
  EXPECT_EQ(results[1].partial_pose->rotation_stddev_rad, 0.25);
}

TEST(Report, QueriesBelowTheMinimumConfidenceAreNotLocalized) {
  const SyntheticGroup scene = MakeGroup(2, 2);
  const StageInput input = MakeStageInput(scene);
  PoseEvidence good, bad;
  good.num_common_tracks = 200;
  good.explained_ratio = good.agreeing_ratio = 1;
  bad.num_common_tracks = 0;
  bad.median_error_px = bad.position_stddev_ratio = 1;
  Report report(scene.group);
  report.AddEvidence(input.layout, {good, bad}, 0.5);
  const std::vector<LocalizationResult> results = std::move(report).Finish();
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
}

TEST(Report, StartIsThatOfTheFrame) {
  const SyntheticGroup scene = MakeGroup(2, 2);
  const StageInput input = MakeStageInput(scene);
  Report report(scene.group);
  report.AddStart(input.layout, {input.truth, {StartPose::MOTION_AVERAGING, StartPose::ABSOLUTE_POSE}});
  std::vector<std::string> starts;
  for (const LocalizationResult& result : std::move(report).Finish()) starts.push_back(result.start);
  EXPECT_THAT(starts, ElementsAre("motion_averaging", "motion_averaging", "absolute_pose", "absolute_pose"));
}

TEST(Report, PosesAreThoseOfTheDatabasesCoordinates) {
  const SyntheticGroup scene = MakeGroup(2, 3);
  StageInput input = MakeStageInput(scene);
  ASSERT_GT(input.layout.origin.norm(), 0.1);
  Report report(scene.group);
  report.AddPoses(input.layout, input.truth);
  const std::vector<LocalizationResult> results = std::move(report).Finish();
  for (size_t query = 0; query < results.size(); ++query) {
    EXPECT_LE(PositionError(results[query].cam_from_world, scene.cam_from_world[query]), 1e-9);
    EXPECT_LE(RotationErrorDeg(results[query].cam_from_world, scene.cam_from_world[query]), 1e-5);
    EXPECT_LE(PositionError(results[query].rig_from_world, scene.cam_from_world[query / 3 * 3]), 1e-9);
    EXPECT_EQ(results[query].rig_scale, 1);
  }
}

TEST(Report, EstimatedScaleIsPartOfTheRig) {
  const SyntheticGroup scene = MakeGroup(1, 3);
  StageInput input = MakeStageInput(scene);
  input.truth.frames[0].scale = 2;
  for (Image& image : input.truth.images) image.cam_from_frame.translation *= 2;
  Report report(scene.group);
  report.AddPoses(input.layout, input.truth);
  for (const LocalizationResult& result : std::move(report).Finish()) {
    EXPECT_EQ(result.rig_scale, 2);
    EXPECT_LE(PositionError(result.rig_from_world, scene.cam_from_world[0]), 1e-9);
  }
}

TEST(Report, PairErrorsAreThoseOfThePairsInUse) {
  const SyntheticGroup scene = MakeGroup(2, 1);
  StageInput input = MakeStageInput(scene);
  Random random(1);
  Rigid3d& pose = input.truth.frames[1].frame_from_world;
  const Eigen::Vector3d centre = CamInWorld(pose);
  pose = CamFromWorld(Disturbed(pose.rotation, 1, &random), centre);
  Averaged averaged;
  for (const int pair : {0, 4, 5, 8}) averaged.pairs.push_back(&input.pairs[pair]);  // the last one is of two queries
  averaged.directions.resize(4);
  averaged.directions[1].dir_1to2_in_world =
      DisturbedDirection(centre - CamInWorld(CamFromWorld(input.truth, input.pairs[4].other)), 2, &random).normalized();
  Report report(scene.group);
  report.AddPairErrors(input.layout, averaged, input.truth);
  const std::vector<LocalizationResult> results = std::move(report).Finish();
  EXPECT_NEAR(results[0].pairs[0].rotation_error_deg, 0, 1e-5);
  EXPECT_TRUE(std::isnan(results[0].pairs[1].rotation_error_deg));
  EXPECT_NEAR(results[1].pairs[0].rotation_error_deg, 1, 1e-5);
  EXPECT_NEAR(results[1].pairs[1].rotation_error_deg, 1, 1e-5);
  EXPECT_NEAR(results[1].pairs[0].direction_error_deg, 2, 1e-5);
  EXPECT_TRUE(std::isnan(results[1].pairs[1].direction_error_deg)) << "the pair has no direction";
}

// Checks that corrections of database poses do not count, because a reader of the result has the poses as given.
TEST(Report, PointsHaveErrorsAgainstTheDatabaseAsGiven) {
  const SyntheticGroup scene = MakeGroup(1, 1);
  const StageInput input = MakeStageInput(scene);
  Refined refined;
  refined.adjustment.posed = input.truth;
  refined.adjustment.tracks = input.tracks;
  refined.rig_errors_px = {0.125};
  Random random(1);
  for (Frame& frame : refined.adjustment.posed.frames) {
    if (frame.is_database) frame.frame_from_world = DisturbedPose(frame.frame_from_world, 1, 0.1, &random);
  }
  Report report(scene.group);
  report.AddRefined(input.layout, refined);
  const LocalizationResult result = std::move(report).Finish().front();
  EXPECT_EQ(result.rig_error_px, 0.125);
  EXPECT_EQ(result.num_tracks, kNumPoints);
  EXPECT_EQ(result.num_observations, kNumPoints * (1 + kNumDatabaseImages));
  EXPECT_LE(result.mean_reprojection_error_px, 1e-6);
  ASSERT_EQ(result.points.size(), static_cast<size_t>(kNumPoints));
  for (int i = 0; i < kNumPoints; ++i) {
    EXPECT_LE((result.points[i].point_in_world - scene.points_in_world[i]).norm(), 1e-12);
    EXPECT_EQ(result.points[i].query_point, i);
    EXPECT_THAT(result.points[i].observations, ElementsAre(Pair(0, i), Pair(1, i), Pair(2, i), Pair(3, i)));
    EXPECT_LE(result.points[i].mean_reprojection_error_px, 1e-6);
  }
}

TEST(Report, ATrackOfTwoQueriesCountsForBoth) {
  const SyntheticGroup scene = MakeGroup(1, 2);
  const StageInput input = MakeStageInput(scene);
  Refined refined;
  refined.adjustment.posed = input.truth;
  Track track = input.tracks[3];
  track.observations.resize(2);  // query 0 and one database image
  track.observations.insert(track.observations.begin() + 1, input.tracks[kNumPoints + 3].observations.front());
  refined.adjustment.tracks = {track};
  refined.rig_errors_px.resize(2);
  Report report(scene.group);
  report.AddRefined(input.layout, refined);
  for (const LocalizationResult& result : std::move(report).Finish()) {
    EXPECT_EQ(result.num_tracks, 1);
    EXPECT_EQ(result.num_observations, 2);
    ASSERT_EQ(result.points.size(), 1u);
    EXPECT_THAT(result.points[0].observations, ElementsAre(Pair(0, 3)));
  }
}

TEST(Report, UncertaintiesAndCameraAreThoseOfTheQuery) {
  const SyntheticGroup scene = MakeGroup(1, 2);
  std::vector<PoseUncertainty> uncertainties(2);
  for (int query = 0; query < 2; ++query) {
    uncertainties[query].covariance.setConstant(query + 1);
    uncertainties[query].spread.rotation_stddev_rad = query + 1;
  }
  Camera camera = scene.group.images[0].problem.query_camera;
  camera.params[0] = 500;
  Report report(scene.group);
  report.AddUncertainties(uncertainties);
  report.AddCameras({camera, std::nullopt});
  const std::vector<LocalizationResult> results = std::move(report).Finish();
  for (int query = 0; query < 2; ++query) {
    EXPECT_EQ(results[query].covariance(2, 3), query + 1);
    EXPECT_EQ(results[query].spread.rotation_stddev_rad, query + 1);
    EXPECT_EQ(results[query].is_camera_refined, query == 0);
  }
  EXPECT_EQ(results[0].query_camera.params[0], 500);
}

TEST(Report, SecondsOfAGroupAreSharedOut) {
  const SyntheticGroup scene = MakeGroup(1, 2);
  Report report(scene.group);
  report.Seconds()->emplace_back("two_view", 3);
  report.Seconds()->emplace_back("tracks", 1);
  for (const LocalizationResult& result : std::move(report).Finish()) {
    EXPECT_THAT(result.seconds, ElementsAre(Pair("two_view", 1.5), Pair("tracks", 0.5)));
  }
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/pipeline/pose_evidence.h"

#include <cmath>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/stages_test_input.h"

namespace lazyloc {
namespace {

constexpr int kNumPoints = 40, kNumDatabaseImages = 8;
constexpr double kDistance = 5;

SyntheticGroup MakeGroup(int num_frames, int num_sensors) {
  SyntheticGroupOptions options;
  options.num_frames = num_frames;
  options.num_sensors = num_sensors;
  options.num_points = kNumPoints;
  options.num_database_images = kNumDatabaseImages;
  return MakeSyntheticGroup(options);
}

// Returns the pose that a pair's relative pose would have if the query were at another place.
void Relocate(const Layout& layout, const Rigid3d& query_from_world, PairGeometry* pair) {
  pair->query_from_other = query_from_world * Inverse(CamFromWorld(layout.given, pair->other));
  pair->query_from_other.translation.normalize();
}

TEST(CountVotes, AllPairsAgreeWithTheTruth) {
  const StageInput input = MakeStageInput(MakeGroup(1, 2));
  const PairVotes votes = CountVotes(input.layout, input.pairs, 0, input.truth.frames[0].frame_from_world, kDistance);
  EXPECT_EQ(votes.num_agreeing, 2 * kNumDatabaseImages * kNumPoints);
  EXPECT_EQ(votes.num_rival, 0);
}

TEST(CountVotes, RivalIsTheOtherPlaceOfThreePairs) {
  StageInput input = MakeStageInput(MakeGroup(1, 1));
  const Rigid3d truth = input.truth.frames[0].frame_from_world;
  Rigid3d elsewhere = truth;
  elsewhere.translation += Eigen::Vector3d(4, 2, 0);
  for (const int pair : {0, 1, 2}) Relocate(input.layout, elsewhere, &input.pairs[pair]);
  const PairVotes votes = CountVotes(input.layout, input.pairs, 0, truth, kDistance);
  EXPECT_EQ(votes.num_agreeing, (kNumDatabaseImages - 3) * kNumPoints);
  EXPECT_EQ(votes.num_rival, 3 * kNumPoints);
}

TEST(CountVotes, TwoPairsOfAnotherRotationAreARival) {
  StageInput input = MakeStageInput(MakeGroup(1, 1));
  const Rigid3d truth = input.truth.frames[0].frame_from_world;
  const Rigid3d elsewhere = Rigid3d{ExpSO3({0, 0.5, 0}), {1, 0, 0}} * truth;
  for (const int pair : {0, 1}) Relocate(input.layout, elsewhere, &input.pairs[pair]);
  EXPECT_EQ(CountVotes(input.layout, input.pairs, 0, truth, kDistance).num_rival, 2 * kNumPoints);
}

TEST(CountVotes, PairWhoseMatchesThePoseExplainsAgrees) {
  StageInput input = MakeStageInput(MakeGroup(1, 1));
  const Rigid3d truth = input.truth.frames[0].frame_from_world;
  const Rigid3d elsewhere = Rigid3d{ExpSO3({0, 0.5, 0}), {1, 0, 0}} * truth;
  for (const int pair : {0, 1}) Relocate(input.layout, elsewhere, &input.pairs[pair]);
  std::vector<int> num_explained(input.layout.given.images.size(), kNumPoints);
  EXPECT_EQ(CountVotes(input.layout, input.pairs, 0, truth, kDistance, num_explained).num_rival, 0);
  num_explained.assign(num_explained.size(), kNumPoints / 4);
  EXPECT_EQ(CountVotes(input.layout, input.pairs, 0, truth, kDistance, num_explained).num_rival, 2 * kNumPoints);
}

TEST(CountVotes, NearbyPoseIsNoRival) {
  StageInput input = MakeStageInput(MakeGroup(1, 1));
  const Rigid3d truth = input.truth.frames[0].frame_from_world;
  const Rigid3d nearby = Rigid3d{ExpSO3({0, 0.15, 0}), {0.1, 0, 0}} * truth;
  for (const int pair : {0, 1, 2, 3}) Relocate(input.layout, nearby, &input.pairs[pair]);
  const PairVotes votes = CountVotes(input.layout, input.pairs, 0, truth, 50 * kDistance);
  EXPECT_EQ(votes.num_agreeing, (kNumDatabaseImages - 4) * kNumPoints);
  EXPECT_EQ(votes.num_rival, 0);
}

TEST(CountVotes, TwoPairsOfTheSameRotationAreNoRival) {
  StageInput input = MakeStageInput(MakeGroup(1, 1));
  const Rigid3d truth = input.truth.frames[0].frame_from_world;
  Rigid3d elsewhere = truth;
  elsewhere.translation += Eigen::Vector3d(1.5, 0.5, 0);
  for (const int pair : {0, 1}) Relocate(input.layout, elsewhere, &input.pairs[pair]);
  EXPECT_EQ(CountVotes(input.layout, input.pairs, 0, truth, kDistance).num_rival, 0);
}

TEST(CountVotes, ScatteredPairsAreNoRival) {
  StageInput input = MakeStageInput(MakeGroup(1, 1));
  Random random(1);
  for (PairGeometry& pair : input.pairs) {
    pair.query_from_other.rotation = Disturbed(pair.query_from_other.rotation, 60, &random);
  }
  const PairVotes votes = CountVotes(input.layout, input.pairs, 0, input.truth.frames[0].frame_from_world, kDistance);
  EXPECT_EQ(votes.num_agreeing, 0);
  EXPECT_EQ(votes.num_rival, 0);
}

class MeasureEvidenceTest : public ::testing::Test {
 protected:
  void Make(int num_frames, int num_sensors) {
    input_ = MakeStageInput(MakeGroup(num_frames, num_sensors));
    estimates_.pairs = input_.pairs;
    estimates_.num_inliers.assign(input_.layout.num_queries, std::vector<int>(kNumDatabaseImages, kNumPoints));
    refined_.adjustment.posed = input_.truth;
    refined_.adjustment.tracks = input_.tracks;
    uncertainties_.assign(input_.layout.num_queries, {});
    for (PoseUncertainty& uncertainty : uncertainties_) {
      uncertainty.spread.position_stddevs = {0.3, 0.2, 0.1};
      uncertainty.spread.rotation_stddev_rad = 0.01;
    }
    start_ = input_.truth;
  }
  std::vector<PoseEvidence> Measure(bool has_relative_poses = true) const {
    return MeasureEvidence(input_.layout, estimates_, has_relative_poses, start_, refined_, uncertainties_);
  }

  StageInput input_;
  PairEstimates estimates_;
  PosedImages start_;
  Refined refined_;
  std::vector<PoseUncertainty> uncertainties_;
};

TEST_F(MeasureEvidenceTest, OfTheTruthIsPerfect) {
  Make(1, 1);
  const PoseEvidence evidence = Measure().front();
  EXPECT_EQ(evidence.num_common_tracks, kNumPoints);
  EXPECT_EQ(evidence.explained_ratio, 1);
  EXPECT_EQ(evidence.agreeing_ratio, 1);
  EXPECT_EQ(evidence.rival_ratio, 0);
  EXPECT_LE(evidence.median_error_px, 1e-6);
  EXPECT_EQ(evidence.start_distance_ratio, 0);
  EXPECT_GT(evidence.scene_distance, 0);
  EXPECT_NEAR(evidence.position_stddev_ratio, 0.3 / evidence.scene_distance, 1e-12);
  EXPECT_LE(evidence.mean_error_px, 1e-6);
  EXPECT_EQ(evidence.mean_track_length, 1 + kNumDatabaseImages);
  EXPECT_NEAR(evidence.rotation_stddev_deg, RadToDeg(0.01), 1e-12);
  EXPECT_NEAR(evidence.rotation_position_ratio, 0.01 * evidence.scene_distance / 0.3, 1e-12);
}

TEST_F(MeasureEvidenceTest, CountsTheTracksAndMatchesThatAreLeft) {
  Make(1, 1);
  auto& tracks = refined_.adjustment.tracks;
  tracks.resize(10);
  for (Track& track : tracks) track.observations.resize(2);
  tracks[0] = input_.tracks[0];
  const PoseEvidence evidence = Measure().front();
  EXPECT_EQ(evidence.num_common_tracks, 1);
  EXPECT_DOUBLE_EQ(evidence.mean_track_length, (9 * 2 + 1 + kNumDatabaseImages) / 10.0);
  EXPECT_DOUBLE_EQ(evidence.explained_ratio, (9.0 + kNumDatabaseImages) / (kNumPoints * kNumDatabaseImages));
}

TEST_F(MeasureEvidenceTest, LengthOfTracksTellsNothingWithTwoDatabaseImages) {
  Make(1, 1);
  for (Track& track : refined_.adjustment.tracks) track.observations.resize(4);
  EXPECT_EQ(Measure().front().mean_track_length, 4);
  for (Track& track : refined_.adjustment.tracks) track.observations.resize(3);
  EXPECT_TRUE(std::isnan(Measure().front().mean_track_length));
}

TEST_F(MeasureEvidenceTest, LengthOfTracksTellsNothingIfNoPointIsSeenByTwoDatabaseImages) {
  Make(1, 1);
  std::vector<Track>& tracks = refined_.adjustment.tracks;
  for (size_t i = 0; i < tracks.size(); ++i) {
    tracks[i].observations[1] = tracks[i].observations[1 + i % kNumDatabaseImages];
    tracks[i].observations.resize(2);
  }
  const PoseEvidence evidence = Measure().front();
  EXPECT_EQ(evidence.num_common_tracks, 0);
  EXPECT_TRUE(std::isnan(evidence.mean_track_length));
}

TEST_F(MeasureEvidenceTest, ADatabasePoseThatAdjustmentMovedRaisesTheMeanErrorAndNotTheMedian) {
  Make(1, 1);
  input_.layout.given.frames[input_.layout.num_query_frames].frame_from_world.translation.x() += 0.1;
  const PoseEvidence evidence = Measure().front();
  EXPECT_LE(evidence.median_error_px, 1e-6);
  EXPECT_GT(evidence.mean_error_px, 0.5);
}

TEST_F(MeasureEvidenceTest, MatchesThatNoTrackTriedDoNotCount) {
  Make(1, 1);
  refined_.adjustment.tracks.resize(10);
  refined_.tried_ratio = 20.0 / kNumPoints;
  EXPECT_DOUBLE_EQ(Measure().front().explained_ratio, 0.5);
}

TEST_F(MeasureEvidenceTest, SeparatesFrames) {
  Make(2, 2);
  start_.frames[1].frame_from_world.translation += Eigen::Vector3d(0, 0, 0.5);
  const std::vector<PoseEvidence> evidence = Measure();
  ASSERT_EQ(evidence.size(), 2u);
  EXPECT_EQ(evidence[0].start_distance_ratio, 0);
  EXPECT_NEAR(evidence[1].start_distance_ratio, 0.5 / evidence[1].scene_distance, 1e-9);
  EXPECT_EQ(evidence[0].explained_ratio, 1);
}

TEST_F(MeasureEvidenceTest, VotesAreUnknownWithoutRelativePoses) {
  Make(1, 1);
  const PoseEvidence evidence = Measure(/*has_relative_poses=*/false).front();
  EXPECT_TRUE(std::isnan(evidence.agreeing_ratio) && std::isnan(evidence.rival_ratio));
  EXPECT_EQ(evidence.explained_ratio, 1);
}

}  // namespace
}  // namespace lazyloc

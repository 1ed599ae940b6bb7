#include "colmap_lazyloc/uncertainty/pose_evidence.h"

#include <utility>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

constexpr int kNumPoints = 40, kNumDatabaseImages = 8;

class MeasureEvidenceTest : public ::testing::Test {
 protected:
  void Make(int num_frames, int num_sensors) {
    scene_ = MakeGroup(num_frames, num_sensors, kNumPoints, kNumDatabaseImages);
    input_ = MakeStageInput(scene_);
    estimates_.pairs = input_.pairs;
    estimates_.num_inliers.assign(input_.layout.num_queries, std::vector<int>(kNumDatabaseImages, kNumPoints));
    refined_.adjustment.posed = input_.truth;
    refined_.adjustment.tracks = input_.tracks;
    const Eigen::Matrix3d position_covariance = Eigen::Vector3d(0.09, 0.04, 0.01).asDiagonal();
    poses_.clear();
    for (int query = 0; query < input_.layout.num_queries; ++query) {
      poses_.push_back(
          MakePoseDistribution(CamFromWorld(input_.truth, query), Eigen::Matrix3d::Zero(), position_covariance));
    }
  }
  std::vector<PoseEvidence> Measure() const { return MeasureEvidence(input_.layout, estimates_, refined_, poses_); }

  SyntheticGroup scene_;
  StageInput input_;
  PairEstimates estimates_;
  Refined refined_;
  std::vector<PoseDistribution> poses_;
};

TEST_F(MeasureEvidenceTest, OfTheTruthIsPerfect) {
  Make(1, 1);
  const PoseEvidence evidence = Measure().front();
  EXPECT_EQ(evidence.num_common_tracks, kNumPoints);
  EXPECT_EQ(evidence.explained_ratio, 1);
  EXPECT_EQ(evidence.agreeing_ratio, 1);
  EXPECT_EQ(evidence.num_single_tracks, 0);
  EXPECT_LE(evidence.median_error_px, 1e-6);
  EXPECT_GT(evidence.scene_distance, 0);
  EXPECT_NEAR(evidence.position_stddev_ratio, 0.3 / evidence.scene_distance, 1e-12);
}

TEST_F(MeasureEvidenceTest, CountsTheTracksAndMatchesThatAreLeft) {
  Make(1, 1);
  auto& tracks = refined_.adjustment.tracks;
  tracks.resize(10);
  for (Track& track : tracks) track.observations.resize(2);
  tracks[0] = input_.tracks[0];
  const PoseEvidence evidence = Measure().front();
  EXPECT_EQ(evidence.num_common_tracks, 1);
  EXPECT_EQ(evidence.num_single_tracks, 9);
  EXPECT_DOUBLE_EQ(evidence.explained_ratio, (9.0 + kNumDatabaseImages) / (kNumPoints * kNumDatabaseImages));
}

// Sets the relative poses of the first pairs to those of a query that is turned by an angle about the y axis and moved.
void Relocate(const StageInput& input, int num_pairs, double angle_rad, const Eigen::Vector3d& shift,
              std::vector<PairGeometry>* pairs) {
  const Rigid3d elsewhere = Rigid3d{ExpSO3({0, angle_rad, 0}), shift} * CamFromWorld(input.truth, 0);
  for (int i = 0; i < num_pairs; ++i) {
    PairGeometry& pair = (*pairs)[i];
    pair.query_from_other = elsewhere * Inverse(CamFromWorld(input.layout.given, pair.other));
    pair.query_from_other.translation.normalize();
  }
}

TEST_F(MeasureEvidenceTest, PairsOfAnotherRotationOrDirectionDoNotAgree) {
  for (const auto& [angle_rad, shift] : {std::pair{0.5, 0.0}, std::pair{0.0, 4.0}}) {
    Make(1, 1);
    refined_.adjustment.tracks.resize(1);  // so that hardly any match is in a track
    Relocate(input_, 3, angle_rad, {shift, shift / 2, 0}, &estimates_.pairs);
    EXPECT_DOUBLE_EQ(Measure().front().agreeing_ratio, (kNumDatabaseImages - 3.0) / kNumDatabaseImages);
  }
}

TEST_F(MeasureEvidenceTest, ScatteredPairsDoNotAgree) {
  Make(1, 1);
  refined_.adjustment.tracks.resize(1);
  Random random(1);
  for (PairGeometry& pair : estimates_.pairs) {
    pair.query_from_other.rotation = Disturbed(pair.query_from_other.rotation, 60, &random);
  }
  EXPECT_EQ(Measure().front().agreeing_ratio, 0);
}

TEST_F(MeasureEvidenceTest, PairWithMostOfItsMatchesInTracksAgreesWhateverItsRelativePose) {
  Make(1, 1);
  Relocate(input_, 3, 0.5, {1, 0, 0}, &estimates_.pairs);
  EXPECT_EQ(Measure().front().agreeing_ratio, 1);
}

TEST_F(MeasureEvidenceTest, SmallDifferencesAgree) {
  Make(1, 1);
  refined_.adjustment.tracks.resize(1);
  Relocate(input_, 3, 0.05, {0.02, 0, 0}, &estimates_.pairs);
  EXPECT_EQ(Measure().front().agreeing_ratio, 1);
}

TEST_F(MeasureEvidenceTest, SeparatesFrames) {
  Make(2, 2);
  for (PairGeometry& pair : estimates_.pairs) {
    if (input_.layout.FrameOf(pair.query) == 1) pair.query_from_other.rotation = ExpSO3({0, 1, 0});
  }
  // Leaves the second frame few of its tracks, so that these do not make its pairs agree.
  std::vector<Track> tracks;
  int num_of_second = 0;
  for (const Track& track : input_.tracks) {
    const bool is_of_second = input_.layout.FrameOf(track.observations.front().image) == 1;
    if (!is_of_second || ++num_of_second <= 4) tracks.push_back(track);
  }
  refined_.adjustment.tracks = tracks;
  const std::vector<PoseEvidence> evidence = Measure();
  ASSERT_EQ(evidence.size(), 2u);
  EXPECT_EQ(evidence[0].agreeing_ratio, 1);
  EXPECT_LT(evidence[1].agreeing_ratio, 0.1);
}

TEST_F(MeasureEvidenceTest, WithAnEstimatedFocalLengthThePairsThatFitAgree) {
  Make(1, 1);
  refined_.adjustment.tracks.resize(1);
  Relocate(input_, kNumDatabaseImages, 0.5, {1, 0, 0}, &estimates_.pairs);
  refined_.camera.emplace(scene_.group.images.front().problem);
  EXPECT_EQ(Measure().front().agreeing_ratio, 1);
  refined_.camera->ScaleFocalLength(1.5);
  EXPECT_LE(Measure().front().agreeing_ratio, 1.0 / kNumDatabaseImages);
}

}  // namespace
}  // namespace lazyloc

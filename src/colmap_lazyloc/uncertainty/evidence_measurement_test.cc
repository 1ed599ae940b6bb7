#include "colmap_lazyloc/uncertainty/evidence_measurement.h"

#include <vector>

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

constexpr int kNumPoints = 40, kNumDatabaseImages = 8;

class MeasureEvidenceTest : public ::testing::Test {
 protected:
  void Make(int num_frames, int num_sensors) {
    input_ = MakeStageInput(MakeGroup(num_frames, num_sensors, kNumPoints, kNumDatabaseImages));
    num_inliers_.assign(input_.layout.num_queries, std::vector<int>(kNumDatabaseImages, kNumPoints));
    refined_.adjustment.posed = input_.truth;
    refined_.adjustment.tracks = input_.tracks;
    const Eigen::Matrix3d position_covariance = Eigen::Vector3d(0.09, 0.04, 0.01).asDiagonal();
    poses_.clear();
    for (int query = 0; query < input_.layout.num_queries; ++query) {
      poses_.push_back(
          MakePoseDistribution(CamFromWorld(input_.truth, query), Eigen::Matrix3d::Zero(), position_covariance));
    }
  }
  std::vector<PoseEvidence> Measure() const { return MeasureEvidence(input_.layout, num_inliers_, refined_, poses_); }

  StageInput input_;
  std::vector<std::vector<int>> num_inliers_;
  Refined refined_;
  std::vector<PoseDistribution> poses_;
};

TEST_F(MeasureEvidenceTest, OfTheTruthIsPerfect) {
  Make(1, 1);
  const PoseEvidence evidence = Measure().front();
  EXPECT_EQ(evidence.num_common_tracks, kNumPoints);
  EXPECT_EQ(evidence.explained_ratio, 1);
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

TEST_F(MeasureEvidenceTest, TracksThatTheDatabaseSeesFromOneDirectionCountAsOfASingleImage) {
  Make(1, 1);
  auto& tracks = refined_.adjustment.tracks;
  for (size_t i = 1; i < tracks.size(); ++i) tracks[i].noise_ratio = 3;
  const PoseEvidence evidence = Measure().front();
  EXPECT_EQ(evidence.num_common_tracks, 1);
  EXPECT_EQ(evidence.num_single_tracks, kNumPoints - 1);
  EXPECT_EQ(evidence.explained_ratio, 1);
}

TEST_F(MeasureEvidenceTest, SeparatesFrames) {
  Make(2, 2);
  // Leaves the second frame four of its tracks.
  std::vector<Track> tracks;
  int num_of_second = 0;
  for (const Track& track : input_.tracks) {
    const bool is_of_second = input_.layout.FrameOf(track.observations.front().image) == 1;
    if (!is_of_second || ++num_of_second <= 4) tracks.push_back(track);
  }
  refined_.adjustment.tracks = tracks;
  const std::vector<PoseEvidence> evidence = Measure();
  ASSERT_EQ(evidence.size(), 2u);
  EXPECT_EQ(evidence[0].explained_ratio, 1);
  EXPECT_LT(evidence[1].explained_ratio, 0.2);
  EXPECT_EQ(evidence[1].num_common_tracks, 4);
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/initialization/competing_pose.h"

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

constexpr int kNumPoints = 60;

// Moves the points of the first tracks of a frame to where it would see them from another pose.
void Relocate(const StageInput& input, int frame, int num_tracks, const Rigid3d& other_from_world,
              SplitTracks* tracks) {
  const Rigid3d moved = Inverse(other_from_world) * input.truth.frames[frame].frame_from_world;
  for (Track& track : tracks->from_database) {
    if (input.layout.FrameOf(track.observations.front().image) != frame || num_tracks-- <= 0) continue;
    track.point_in_world = moved * track.point_in_world;
  }
}

class CompetingPoseTest : public ::testing::Test {
 protected:
  explicit CompetingPoseTest(int num_frames = 2, int num_sensors = 2)
      : input_(MakeStageInput(MakeGroup(num_frames, num_sensors, kNumPoints, /*num_database_images=*/6))),
        tracks_{input_.tracks, {}} {}

  const Rigid3d& Truth(int frame) const { return input_.truth.frames[frame].frame_from_world; }
  std::optional<CompetingPose> Find(int frame) const {
    const TrackRefs from_database = TracksByFrame(input_.layout, tracks_.from_database)[frame];
    return FindCompetingPose(input_.layout, from_database, {}, frame, Truth(frame), /*seed=*/0);
  }

  StageInput input_;
  SplitTracks tracks_;
};

TEST_F(CompetingPoseTest, NothingCompetesIfAllPointsAreExplained) {
  EXPECT_FALSE(Find(0));
  EXPECT_FALSE(Find(1));
}

TEST_F(CompetingPoseTest, IsThePoseThatTheOtherPointsSpeakFor) {
  Random random(1);
  const Rigid3d other = DisturbedPose(Truth(1), 40, 2, &random);
  Relocate(input_, 1, 2 * kNumPoints / 3, other, &tracks_);  // a third of the tracks of its two images
  EXPECT_FALSE(Find(0)) << "another frame";
  const std::optional<CompetingPose> competing = Find(1);
  ASSERT_TRUE(competing);
  EXPECT_LE(PositionError(competing->frame_from_world, other), 1e-3);
  EXPECT_NEAR(competing->score_ratio, 0.5, 0.1);
}

TEST_F(CompetingPoseTest, TheRatioExceedsOneIfMostPointsSpeakForIt) {
  Random random(2);
  Relocate(input_, 0, 3 * kNumPoints / 2, DisturbedPose(Truth(0), 40, 2, &random), &tracks_);
  const std::optional<CompetingPose> competing = Find(0);
  ASSERT_TRUE(competing);
  EXPECT_NEAR(competing->score_ratio, 3, 0.5);
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/scene/quarter_turns.h"

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

TEST(QuarterTurns, MoveTheCornersOfAnImageCounterClockwise) {
  constexpr float kWidth = 40, kHeight = 30;
  const Keypoint right_of_top_left{3, 1};
  const Keypoint once = Turned(right_of_top_left, 1, kWidth, kHeight);
  EXPECT_EQ(once.x, 1);
  EXPECT_EQ(once.y, kWidth - 3);
  EXPECT_EQ(once.a21, -1) << "what pointed to the right points up";
  const Keypoint twice = Turned(right_of_top_left, 2, kWidth, kHeight);
  EXPECT_EQ(twice.x, kWidth - 3);
  EXPECT_EQ(twice.y, kHeight - 1);
  EXPECT_EQ(twice.a11, -1);
}

TEST(QuarterTurns, AreUndoneAndFoundAgainInTheShape) {
  for (const int turns : {0, 1, 2, 3}) {
    const bool is_swapped = turns % 2 == 1;
    const Keypoint upright{3, 1, 2, 0.25f, -0.125f, 1.5f};
    const float width = 40, height = 30;  // as stored
    const Keypoint stored = Turned(upright, TurnsBack(turns), is_swapped ? height : width, is_swapped ? width : height);
    const Keypoint again = Turned(stored, turns, width, height);
    EXPECT_EQ(again.x, upright.x);
    EXPECT_EQ(again.y, upright.y);
    EXPECT_EQ(again.a12, upright.a12);
    EXPECT_EQ(again.a21, upright.a21);
    EXPECT_EQ(TurnsBeforeExtraction(stored), turns);
  }
}

// COLMAP 4: GravityFromExifOrientation and ComputeRot90FromGravity.
TEST(QuarterTurns, FollowExifAsInColmap4) {
  const int turns_of_orientation[] = {0, 0, 0, 2, 0, 0, 3, 0, 1, 0};
  for (int orientation = 0; orientation < 10; ++orientation) {
    EXPECT_EQ(TurnsOfExif(orientation), turns_of_orientation[orientation]) << orientation;
    EXPECT_EQ(IsMirrored(orientation), orientation == 2 || orientation == 4 || orientation == 5 || orientation == 7);
  }
}

}  // namespace
}  // namespace lazyloc

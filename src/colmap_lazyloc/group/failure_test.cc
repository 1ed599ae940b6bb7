#include "colmap_lazyloc/group/failure.h"

#include <gmock/gmock.h>

namespace lazyloc {
namespace {

TEST(CheckFrames, EachFrameHasItsOwnReason) {
  try {
    CheckFrames(3, QueryStatus::TOO_FEW_TRACKS,
                [](int frame) { return frame == 1 ? Reason() : "frame " + std::to_string(frame); });
    FAIL();
  } catch (const Failure& failure) {
    EXPECT_THAT(failure.frames, testing::ElementsAre(0, 2));
    EXPECT_EQ(failure.ReasonOf(0), "frame 0");
    EXPECT_EQ(failure.ReasonOf(2), "frame 2");
  }
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/io/rig_frames.h"

#include <gmock/gmock.h>

namespace lazyloc {
namespace {

using ::testing::Pair;
using ::testing::UnorderedElementsAre;

TEST(SharedFrameNames, LeavesOutImagesThatAreAloneInTheirFrame) {
  const FramePlaces places = {{"left/1.png", {"1", {}}}, {"right/1.png", {"1", {}}}, {"left/2.png", {"2", {}}}};
  EXPECT_THAT(SharedFrameNames(places), UnorderedElementsAre(Pair("left/1.png", "1"), Pair("right/1.png", "1")));
}

}  // namespace
}  // namespace lazyloc

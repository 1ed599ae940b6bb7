#include "colmap_lazyloc/group/group_partition.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// Returns a group with the images 0 1 | 2 3 | 4 5 and pairs between all of them.
QueryGroup ThreeRigs() {
  SyntheticGroupOptions options;
  options.num_frames = 3;
  options.num_database_images = 1;
  options.num_points = 20;
  return MakeSyntheticGroup(options).group;
}

std::vector<std::string> NamesOf(const QueryGroup& group) {
  std::vector<std::string> names;
  for (const QueryImage& image : group.images) names.push_back(image.problem.query_name);
  return names;
}

TEST(SelectImages, FramesAreNumberedAgain) {
  const QueryGroup group = ThreeRigs();
  const QueryGroup selected = SelectImages(group, {2, 3, 4, 5});
  EXPECT_THAT(NamesOf(selected), ElementsAre("query1-0", "query1-1", "query2-0", "query2-1"));
  EXPECT_THAT(selected.frame_names, ElementsAre("frame1", "frame2"));
  for (size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(selected.images[i].frame, static_cast<int>(i / 2));
    ExpectSameBits(selected.images[i].cam_from_rig, group.images[i + 2].cam_from_rig);
    EXPECT_EQ(selected.images[i].problem.pairs.size(), 1u);
  }
}

TEST(SelectImages, PairsBetweenSelectedQueriesRemain) {
  const QueryGroup selected = SelectImages(ThreeRigs(), {1, 2, 5});
  std::vector<std::pair<int, int>> pairs;
  for (const QueryPair& pair : selected.query_pairs) {
    pairs.emplace_back(pair.query, pair.other);
    EXPECT_EQ(pair.images.other_name, selected.images[pair.other].problem.query_name);
  }
  EXPECT_THAT(pairs, ElementsAre(std::pair(1, 0), std::pair(2, 0), std::pair(2, 1)));
}

TEST(SelectImages, AnImageThatIsLeftAloneBecomesALoneImage) {
  const QueryGroup group = ThreeRigs();
  const QueryGroup selected = SelectImages(group, {1, 2, 3});
  EXPECT_THAT(selected.frame_names, ElementsAre("", "frame1"));
  ExpectSameBits(selected.images[0].cam_from_rig, group.images[1].cam_from_rig);
  ExpectSameBits(selected.images[2].cam_from_rig, group.images[3].cam_from_rig);
}

TEST(SelectImages, KeepsWhatIsKnownOfFrames) {
  QueryGroup group = ThreeRigs();
  for (const bool is_known : {true, false}) {
    group.has_rig_scale = is_known;
    EXPECT_EQ(SelectImages(group, {0, 1}).has_rig_scale, is_known);
  }
}

TEST(ImagesOfFrames, AreInAscendingOrder) {
  const QueryGroup group = ThreeRigs();
  EXPECT_THAT(ImagesOfFrames(group, {0, 2}), ElementsAre(0, 1, 4, 5));
  EXPECT_THAT(ImagesOfFrames(group, {}), IsEmpty());
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/features/visual_index.h"

#include <cmath>

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/random_descriptors.h"

namespace lazyloc {
namespace {

TEST(VisualIndex, ScoresAreSimilarities) {
  IdleThreads idle_threads(1);
  const Descriptors all = RandomDescriptors(1000, 1);
  VisualIndex index(VisualWords::Train(all, 60, 0, &idle_threads));
  for (const int image_id : {1, 2, 4}) index.Add(image_id, all.middleRows(200 * image_id, 100), &idle_threads);
  Descriptors query(40, 128);  // shares 30 features with image 4, and 10 with image 2
  query << all.middleRows(800, 30), all.middleRows(400, 10);
  const auto found = index.Query(query, &idle_threads);
  ASSERT_GE(found.size(), 2u);
  EXPECT_EQ(found[0].first, 4);
  EXPECT_NEAR(found[0].second, 30 / std::sqrt(100), 0.2);  // other features of the same words have votes, too
  EXPECT_EQ(found[1].first, 2);
  EXPECT_NEAR(found[1].second, 10 / std::sqrt(100), 0.2);
}

TEST(VisualIndex, RepeatedStructureCountsByTheRootOfItsNumber) {
  IdleThreads idle_threads(1);
  const Descriptors structures = RandomDescriptors(5, 1);
  VisualIndex index(VisualWords::Train(structures, 5, 0, &idle_threads));
  index.Add(1, structures.row(0).replicate(9, 1), &idle_threads);
  index.Add(2, structures.topRows(4), &idle_threads);
  const auto found = index.Query(structures, &idle_threads);
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0], std::make_pair(2, 4 / std::sqrt(4.0f)));
  EXPECT_EQ(found[1], std::make_pair(1, 3 / std::sqrt(9.0f)));
}

}  // namespace
}  // namespace lazyloc

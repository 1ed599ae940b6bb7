#include "colmap_lazyloc/database/keypoint_cache.h"

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

KeypointCache::Keypoints MakeKeypoints(size_t num_keypoints, float x) {
  return KeypointCache::Keypoints(num_keypoints, Eigen::Vector2f(x, 2));
}

TEST(KeypointCache, ForgetsWhatWasNotUsedForLongest) {
  KeypointCache cache(10);
  cache.Add(1, MakeKeypoints(4, 1));
  cache.Add(2, MakeKeypoints(4, 2));
  ASSERT_NE(cache.Find(1), nullptr);
  cache.Add(3, MakeKeypoints(6, 3));
  EXPECT_EQ(cache.Find(2), nullptr);
  ASSERT_NE(cache.Find(1), nullptr);
  ASSERT_NE(cache.Find(3), nullptr);
  EXPECT_EQ(*cache.Find(1), MakeKeypoints(4, 1));
  EXPECT_EQ(*cache.Find(3), MakeKeypoints(6, 3));
  cache.Add(4, MakeKeypoints(10, 4));
  EXPECT_EQ(cache.Find(1), nullptr);
  EXPECT_EQ(cache.Find(3), nullptr);
  ASSERT_NE(cache.Find(4), nullptr);
}

TEST(KeypointCache, KeepsOneImageThatIsTooLarge) {
  KeypointCache cache(10);
  cache.Add(1, MakeKeypoints(10, 1));
  EXPECT_EQ(*cache.Add(2, MakeKeypoints(11, 2)), MakeKeypoints(11, 2));
  EXPECT_EQ(cache.Find(1), nullptr);
  ASSERT_NE(cache.Find(2), nullptr);
  cache.Add(3, MakeKeypoints(0, 3));
  EXPECT_EQ(cache.Find(2), nullptr);
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/matching/feature_cache.h"

#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/random_descriptors.h"
#include "colmap_lazyloc/testing/test_database.h"
#include "colmap_lazyloc/testing/test_folder.h"

namespace lazyloc {
namespace {

constexpr int kNumFeatures = 100;
constexpr double kImageGb = kNumFeatures * (128 + sizeof(Keypoint)) * 1e-9;

class FeatureCacheTest : public ::testing::Test {
 protected:
  FeatureCacheTest() {
    TestDatabase database(folder_ / "a.db", TestDatabase::Schema::V4_2);
    for (const uint32_t id : {1, 2, 3}) {
      database.AddKeypoints(id, std::vector<Eigen::Vector2d>(kNumFeatures, {1, 2}));
      database.AddDescriptors(id, RandomDescriptors(kNumFeatures, id));
    }
    database.Close();
    reader_ = std::make_unique<FeatureReader>(folder_ / "a.db");
  }

  // Whether the image is still there: then nothing is read, and the same object comes back.
  bool Keeps(FeatureCache* cache, uint32_t image_id, const Features* first) {
    return cache->Get(image_id, *reader_).get() == first;
  }

  TestFolder folder_;
  std::unique_ptr<FeatureReader> reader_;
};

TEST_F(FeatureCacheTest, GivesWhatTheDatabaseHolds) {
  FeatureCache cache(1);
  for (const uint32_t id : {1, 2, 1})
    EXPECT_EQ(cache.Get(id, *reader_)->descriptors, RandomDescriptors(kNumFeatures, id));
}

TEST_F(FeatureCacheTest, KeepsWhatWasUsedLastWithinTheLimit) {
  FeatureCache cache(2.5 * kImageGb);
  const auto first = cache.Get(1, *reader_), second = cache.Get(2, *reader_);
  EXPECT_TRUE(Keeps(&cache, 1, first.get()));
  const auto third = cache.Get(3, *reader_);  // drops the second
  EXPECT_TRUE(Keeps(&cache, 1, first.get()));
  EXPECT_TRUE(Keeps(&cache, 3, third.get()));
  EXPECT_FALSE(Keeps(&cache, 2, second.get()));
}

TEST_F(FeatureCacheTest, LimitOfZeroKeepsNothing) {
  FeatureCache cache(0);
  const auto first = cache.Get(1, *reader_);
  EXPECT_FALSE(Keeps(&cache, 1, first.get()));
  EXPECT_EQ(first->keypoints.size(), size_t{kNumFeatures});
}

}  // namespace
}  // namespace lazyloc

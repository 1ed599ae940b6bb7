#include "colmap_lazyloc/database/lru_cache.h"

#include <string>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

class LruCacheTest : public ::testing::Test {
 protected:
  // The value of an image is as many letters as `size`.
  void Use(uint32_t image_id, size_t size) {
    const auto value = cache_.Get(image_id, [&] {
      ++num_reads_;
      return std::string(size, 'x');
    });
    EXPECT_EQ(value->size(), size);
  }
  bool Keeps(uint32_t image_id, size_t size) {
    const int before = num_reads_;
    Use(image_id, size);
    return num_reads_ == before;
  }

  LruCache<std::string> cache_{[](const std::string& text) { return text.size(); }, 10};
  int num_reads_ = 0;
};

TEST_F(LruCacheTest, ForgetsTheValuesThatWereNotUsedForLongest) {
  Use(1, 4);
  Use(2, 4);
  EXPECT_TRUE(Keeps(1, 4));
  Use(3, 6);
  EXPECT_TRUE(Keeps(3, 6));
  EXPECT_TRUE(Keeps(1, 4));
  EXPECT_FALSE(Keeps(2, 4));
}

TEST_F(LruCacheTest, ReturnsAValueThatIsTooLargeWithoutKeepingIt) {
  Use(1, 11);
  EXPECT_FALSE(Keeps(1, 11));
  EXPECT_FALSE(Keeps(2, 3));
  EXPECT_TRUE(Keeps(2, 3));
}

TEST_F(LruCacheTest, AValueInUseOutlivesItsPlaceInTheCache) {
  const auto first = cache_.Get(1, [] { return std::string("first"); });
  Use(2, 10);
  EXPECT_EQ(*first, "first");
  EXPECT_FALSE(Keeps(1, 5));
}

}  // namespace
}  // namespace lazyloc

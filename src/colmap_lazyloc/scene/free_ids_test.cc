#include "colmap_lazyloc/scene/free_ids.h"

#include <string>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

TEST(FreeIds, GivesIdsAboveTheLargestInUse) {
  FreeIds ids;
  ids.Use(7);
  ids.Use(3);
  EXPECT_EQ(ids.Next(), 8u);
  EXPECT_EQ(ids.Next(), 9u);
  EXPECT_EQ(FreeIds(std::map<uint32_t, std::string>{{2, ""}, {5, ""}}).Next(), 6u);
  EXPECT_EQ(FreeIds(std::map<uint32_t, std::string>()).Next(), 1u);
}

TEST(FreeIds, LargestNumberIsNoId) {
  FreeIds ids;
  ids.Use(std::numeric_limits<uint32_t>::max() - 2);
  EXPECT_EQ(ids.Next(), std::numeric_limits<uint32_t>::max() - 1);
  EXPECT_THROW(ids.Next(), InputError);
}

TEST(FreeId, PrefersTheGivenOne) {
  const std::map<uint32_t, std::string> used = {{2, ""}, {5, ""}};
  EXPECT_EQ(FreeId(3, used), 3u);
  EXPECT_EQ(FreeId(2, used), 6u);
}

}  // namespace
}  // namespace lazyloc

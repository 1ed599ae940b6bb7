#include "colmap_lazyloc/files/external_sorter.h"

#include <random>

#include <gmock/gmock.h>

#include "colmap_lazyloc/testing/test_folder.h"

namespace lazyloc {
namespace {

std::vector<uint32_t> Sorted(ExternalSorter<uint32_t>* sorter) {
  std::vector<uint32_t> sorted;
  sorter->Visit([&](const uint32_t& value) { sorted.push_back(value); });
  return sorted;
}

TEST(ExternalSorter, SortsAnyNumberOfValues) {
  const TestFolder folder;
  std::mt19937 random(1);
  for (const size_t num_values : {0, 1, 9, 10, 11, 20, 997}) {
    std::vector<uint32_t> values(num_values);
    ExternalSorter<uint32_t> sorter(folder / "runs", /*max_num_in_memory=*/10);
    for (uint32_t& value : values) {
      value = random() % 500;
      sorter.Add(value);
    }
    std::sort(values.begin(), values.end());
    EXPECT_EQ(Sorted(&sorter), values) << num_values;
  }
}

TEST(ExternalSorter, WritesNoFileIfMemorySuffices) {
  const TestFolder folder;
  ExternalSorter<uint32_t> sorter(folder / "runs", 10);
  for (uint32_t i = 0; i < 10; ++i) sorter.Add(9 - i);
  EXPECT_EQ(Sorted(&sorter).front(), 0u);
  EXPECT_FALSE(std::filesystem::exists(folder / "runs"));
}

TEST(ExternalSorter, FullDiskIsReported) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP();
  ExternalSorter<uint64_t> sorter("/dev/full", 1000);
  EXPECT_THROW(
      {
        for (uint64_t i = 0; i < 5000; ++i) sorter.Add(i);
      },
      InputError);
}

}  // namespace
}  // namespace lazyloc

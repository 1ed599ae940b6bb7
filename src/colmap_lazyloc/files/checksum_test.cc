#include "colmap_lazyloc/files/checksum.h"

#include <unordered_set>

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/test_folder.h"

namespace lazyloc {
namespace {

TEST(Checksum, OfAFileIsThatOfItsBytes) {
  const TestFolder folder;
  const std::string bytes((1 << 20) + 5, 'x');
  WriteBytes(folder / "file", bytes);
  EXPECT_EQ(Crc32OfFile(folder / "file"), Crc32(bytes));
  EXPECT_EQ(Crc32OfFile(folder / "file", 7), Crc32("xxxxxxx"));
  EXPECT_EQ(Crc32OfFile(folder / "none"), Crc32(""));
}

TEST(Checksum, HashesOfNamesDoNotCollide) {
  EXPECT_EQ(Hash64(""), 0xcbf29ce484222325u);  // from the authors of FNV
  EXPECT_EQ(Hash64("foobar"), 0x85944171f73967e8u);
  std::unordered_set<uint64_t> hashes;
  constexpr int kNumNames = 1000000;  // CRC-32 gives about 116 pairs of equal ones
  for (int i = 0; i < kNumNames; ++i) hashes.insert(Hash64("cam" + std::to_string(i % 7) + "/" + std::to_string(i)));
  EXPECT_EQ(hashes.size(), kNumNames);
}

}  // namespace
}  // namespace lazyloc

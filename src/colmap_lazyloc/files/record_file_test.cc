#include "colmap_lazyloc/files/record_file.h"

#include <filesystem>
#include <vector>

#include <gmock/gmock.h>

#include "colmap_lazyloc/files/checksum.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/testing/test_folder.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAreArray;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

class RecordFileTest : public ::testing::Test {
 protected:
  void Write(const std::vector<std::string>& records) const {
    RecordWriter writer(path_);
    for (const std::string& record : records) writer.Append(record);
  }
  std::vector<std::string> Read() const {
    std::vector<std::string> records;
    RecordReader reader(path_);
    while (reader.Next()) records.push_back(reader.Record());
    return records;
  }

  const TestFolder folder_;
  const std::filesystem::path path_ = folder_ / "records.bin";
  const std::vector<std::string> records_ = {"first", "", std::string("zero \0 and more", 15), std::string(3000, 'x')};
};

TEST(Crc32, IsThatOfZlib) { EXPECT_EQ(Crc32("123456789"), 0xCBF43926u); }

TEST_F(RecordFileTest, RecordsReadBack) {
  Write(records_);
  EXPECT_THAT(Read(), ElementsAreArray(records_));
  RecordReader reader(path_);
  for (const std::string& record : records_) {
    ASSERT_TRUE(reader.Next());
    EXPECT_EQ(reader.ReadAt(reader.Offset(), record.size()), record);
  }
  EXPECT_EQ(reader.NumIntactBytes(), reader.NumBytes());
  EXPECT_THAT([&] { reader.ReadAt(reader.NumBytes() - 1, 2); }, ThrowsMessage<InputError>(HasSubstr("cannot be read")));
}

TEST_F(RecordFileTest, FrontsOfRecordsReadBack) {
  Write(records_);
  RecordReader reader(path_, 4);
  for (const std::string& record : records_) {
    ASSERT_TRUE(reader.Next());
    EXPECT_EQ(reader.Record(), record.substr(0, 4));
  }
  EXPECT_FALSE(reader.Next());
}

// Cuts the file at every byte, as a crash or a full disk may.
TEST_F(RecordFileTest, TornTailIsCutOffAtEveryByte) {
  Write({"first", "second", "third"});
  const std::string bytes = ReadBytes(path_);
  const size_t sizes[] = {5, 6, 5};
  for (size_t length = 0; length < bytes.size(); ++length) {
    WriteBytes(path_, bytes.substr(0, length));
    std::vector<std::string> intact;
    const uint64_t num_cut = RecordWriter(path_).Recover([&](const std::string& record) { intact.push_back(record); });
    size_t num_expected = 0, end = 0;
    while (end + 12 + sizes[num_expected] <= length) end += 12 + sizes[num_expected++];
    EXPECT_EQ(intact.size(), num_expected) << length;
    EXPECT_EQ(num_cut, length - end) << length;
    Write({"fourth"});
    intact.emplace_back("fourth");
    EXPECT_THAT(Read(), ElementsAreArray(intact)) << length;
  }
}

TEST_F(RecordFileTest, DamageIsFoundAtEveryByte) {
  Write({"first", "second"});
  const std::string bytes = ReadBytes(path_);
  for (size_t i = 0; i < bytes.size(); ++i) {
    std::string damaged = bytes;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x10);
    WriteBytes(path_, damaged);
    EXPECT_EQ(Read().size(), i < 12 + 5 ? 0u : 1u) << i;
  }
}

TEST_F(RecordFileTest, ZerosOfAPowerCutAreNotARecord) {
  Write({"first"});
  WriteBytes(path_, ReadBytes(path_) + std::string(4096, '\0'));
  EXPECT_EQ(Read().size(), 1u);
}

TEST_F(RecordFileTest, OnlyOneWriterAtATime) {
  RecordWriter writer(path_);
  EXPECT_THAT([&] { RecordWriter second(path_); }, ThrowsMessage<InputError>(HasSubstr("another process")));
}

TEST_F(RecordFileTest, FullDiskIsReported) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP();
  RecordWriter writer("/dev/full");
  EXPECT_THAT([&] { writer.Append("x"); },
              ThrowsMessage<InputError>(HasSubstr("/dev/full: cannot be written: No space")));
}

}  // namespace
}  // namespace lazyloc

#include "colmap_lazyloc/runs/record_bytes.h"

#include <boost/endian/conversion.hpp>

#include "colmap_lazyloc/runs/record_archive.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

constexpr uint64_t kNumSizesBytes = 3 * sizeof(uint64_t);  // of the sizes of a record's parts

template <typename T>
void Unpack(const std::string& bytes, T* value) {
  std::istringstream stream(bytes);
  cereal::PortableBinaryInputArchive archive(stream);
  archive(*value);
}

void AppendNumber(uint64_t number, std::string* bytes) {
  unsigned char buffer[8];
  boost::endian::store_little_u64(buffer, number);
  bytes->append(reinterpret_cast<const char*>(buffer), sizeof(buffer));
}

uint64_t ReadNumber(const std::string& bytes, size_t offset) {
  LAZYLOC_CHECK(offset + 8 <= bytes.size());
  return boost::endian::load_little_u64(reinterpret_cast<const unsigned char*>(bytes.data()) + offset);
}

}  // namespace

std::string PackGroup(uint64_t group, const std::vector<QueryRecord>& records) {
  std::string bytes;
  AppendNumber(group, &bytes);
  AppendNumber(records.size(), &bytes);
  for (const QueryRecord& record : records) {
    const std::string parts[] = {Pack(record), Pack(record.keypoints), Pack(record.result.points)};
    for (const std::string& part : parts) AppendNumber(part.size(), &bytes);
    for (const std::string& part : parts) bytes += part;
  }
  return bytes;
}

void VisitGroup(const std::string& bytes, const std::function<void(const std::string& name, uint64_t offset)>& visit) {
  const PackedGroupHeader header = ReadPackedGroupHeader(bytes);
  uint64_t offset = sizeof(PackedGroupHeader);
  for (uint64_t i = 0; i < header.num_queries; ++i) {
    QueryRecord record;
    Unpack(bytes.substr(offset + kNumSizesBytes, ReadNumber(bytes, offset)), &record);
    visit(record.result.query_name, offset);
    const uint64_t sizes = ReadNumber(bytes, offset) + ReadNumber(bytes, offset + 8) + ReadNumber(bytes, offset + 16);
    offset += kNumSizesBytes + sizes;
  }
  LAZYLOC_CHECK(offset == bytes.size());
}

PackedGroupHeader ReadPackedGroupHeader(const std::string& bytes) {
  return {ReadNumber(bytes, 0), ReadNumber(bytes, 8)};
}

QueryRecord ReadRecord(uint64_t offset, RecordParts parts, RecordReader* file) {
  const std::string sizes = file->ReadAt(offset, kNumSizesBytes);
  offset += kNumSizesBytes;
  const auto read = [&](size_t part, auto* value) {
    const uint64_t size = ReadNumber(sizes, part * sizeof(uint64_t));
    Unpack(file->ReadAt(offset, size), value);
    offset += size;
  };
  QueryRecord record;
  read(0, &record);
  if (parts != RecordParts::HEAD) read(1, &record.keypoints);
  if (parts == RecordParts::ALL) read(2, &record.result.points);
  return record;
}

}  // namespace lazyloc

#include "colmap_lazyloc/runs/record_bytes.h"

#include <sstream>

#include <boost/endian/conversion.hpp>

#include "colmap_lazyloc/runs/record_archive.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

template <typename T>
std::string Pack(const T& value) {
  std::ostringstream stream;
  cereal::PortableBinaryOutputArchive archive(stream);
  archive(value);
  return stream.str();
}

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

RecordBytes ToBytes(const QueryRecord& record) {
  return {Pack(record), Pack(record.keypoints), Pack(record.result.points)};
}

QueryRecord FromBytes(const RecordBytes& bytes, RecordParts parts) {
  QueryRecord record;
  Unpack(bytes.head, &record);
  if (parts != RecordParts::HEAD) Unpack(bytes.keypoints, &record.keypoints);
  if (parts == RecordParts::ALL) Unpack(bytes.points, &record.result.points);
  return record;
}

std::string PackGroup(uint64_t group, const std::vector<QueryRecord>& records) {
  std::string bytes;
  AppendNumber(group, &bytes);
  AppendNumber(records.size(), &bytes);
  for (const QueryRecord& record : records) {
    const RecordBytes parts = ToBytes(record);
    for (const std::string* part : {&parts.head, &parts.keypoints, &parts.points}) AppendNumber(part->size(), &bytes);
    bytes += parts.head + parts.keypoints + parts.points;
  }
  return bytes;
}

std::vector<PackedQuery> UnpackGroup(const std::string& bytes) {
  const PackedGroupHeader header = ReadPackedGroupHeader(bytes);
  std::vector<PackedQuery> queries;
  uint64_t offset = sizeof(PackedGroupHeader);
  for (uint64_t i = 0; i < header.num_queries; ++i) {
    const PartSizes sizes = ReadPartSizes(bytes, offset);
    const std::string head = bytes.substr(offset + sizeof(PartSizes), sizes.head);
    queries.push_back({FromBytes({head, "", ""}, RecordParts::HEAD).result.query_name, offset});
    offset += sizeof(PartSizes) + sizes.head + sizes.keypoints + sizes.points;
  }
  LAZYLOC_CHECK(offset == bytes.size());
  return queries;
}

PackedGroupHeader ReadPackedGroupHeader(const std::string& bytes) {
  return {ReadNumber(bytes, 0), ReadNumber(bytes, 8)};
}

PartSizes ReadPartSizes(const std::string& bytes, size_t offset) {
  return {ReadNumber(bytes, offset), ReadNumber(bytes, offset + 8), ReadNumber(bytes, offset + 16)};
}

}  // namespace lazyloc

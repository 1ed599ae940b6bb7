#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "colmap_lazyloc/queries/query_record.h"

namespace lazyloc {

// How much of a query's record is read; each part has those before it.
enum class RecordParts { HEAD, KEYPOINTS, ALL };

// The bytes of a record, in parts, because most readers need no points.
struct RecordBytes {
  std::string head, keypoints, points;
};

// Keep every bit of a record on every machine.
RecordBytes ToBytes(const QueryRecord& record);
// bytes: parts that are not wanted may be empty.
QueryRecord FromBytes(const RecordBytes& bytes, RecordParts parts);

// Writes the queries of a group as one string: 8 bytes each for the group's index and number of queries; then, for each
// query, the sizes of its parts, 8 bytes each, and the parts.
std::string PackGroup(uint64_t group, const std::vector<QueryRecord>& records);

// A query in a packed group.
struct PackedQuery {
  std::string name;
  uint64_t offset = 0;  // of the sizes of its parts
};
std::vector<PackedQuery> UnpackGroup(const std::string& bytes);

// The front of a packed group.
struct PackedGroupHeader {
  uint64_t group = 0, num_queries = 0;
};
PackedGroupHeader ReadPackedGroupHeader(const std::string& bytes);

// The sizes of the parts of a record in bytes.
struct PartSizes {
  uint64_t head = 0, keypoints = 0, points = 0;
};
PartSizes ReadPartSizes(const std::string& bytes, size_t offset = 0);

}  // namespace lazyloc

#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "colmap_lazyloc/files/record_file.h"
#include "colmap_lazyloc/scene/query_record.h"

namespace lazyloc {

// How much of a query's record is read; each part has those before it.
enum class RecordParts { HEAD, KEYPOINTS, ALL };

// Writes the queries of a group as one string, which keeps every bit on every machine: 8 bytes each for the group's
// index and number of queries; then, for each query, the sizes of its parts, 8 bytes each, and the parts. Most readers
// need not all of them.
std::string PackGroup(uint64_t group, const std::vector<QueryRecord>& records);

// Visits the queries in a packed group. offset: of the sizes of a query's parts.
void VisitGroup(const std::string& bytes, const std::function<void(const std::string& name, uint64_t offset)>& visit);

// The front of a packed group.
struct PackedGroupHeader {
  uint64_t group = 0, num_queries = 0;
};
PackedGroupHeader ReadPackedGroupHeader(const std::string& bytes);

// Reads a query's record. offset: of the sizes of its parts, in the file.
QueryRecord ReadRecord(uint64_t offset, RecordParts parts, RecordReader* file);

}  // namespace lazyloc

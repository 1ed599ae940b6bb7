#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "colmap_lazyloc/files/record_file.h"
#include "colmap_lazyloc/runs/record_bytes.h"

namespace lazyloc {

// The records of the queries of a run, sorted by name. They stay in their files and are read one at a time, so that
// memory grows only with the names. Every function throws InputError naming a file that cannot be read.
class QueryRecords {
 public:
  // paths: files of packed groups (runs/record_bytes.h). Throws InputError for a damaged record, and for a query that
  // has two.
  explicit QueryRecords(std::vector<std::filesystem::path> paths);

  size_t Size() const { return entries_.size(); }
  // Returns how many records each file has.
  std::vector<size_t> CountByFile() const;
  std::optional<size_t> Find(std::string_view name) const;
  QueryRecord Read(size_t index, RecordParts parts) const;
  // Visits all records, without keypoints and points.
  void ForEach(const std::function<void(const QueryRecord&)>& visit) const;

 private:
  struct Entry {
    std::string name;
    uint64_t offset = 0;  // place in the file
    uint32_t file = 0;
  };
  void AddFile(uint32_t file);
  RecordReader& Reader(uint32_t file) const;

  const std::vector<std::filesystem::path> paths_;
  std::vector<Entry> entries_;
  mutable std::vector<std::unique_ptr<RecordReader>> readers_;  // null if the file is not open
  mutable size_t num_open_ = 0;
};

}  // namespace lazyloc
